"""Compiling what looks at images need, whatever the detector and the setting."""

from __future__ import annotations

from panoptic_ros.detection import area, region_maps, resemblance, score_maps
from panoptic_ros.detection.decoders import center_heads


def warm_up() -> None:
    """All kernels: of smaller images, of the decoder, of maps, and of how far 2D people are apart."""
    for part in (area, center_heads, score_maps, region_maps, resemblance):
        part.warm_up()
