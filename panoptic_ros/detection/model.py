"""Network as the stage receives it: its card, its bytes, and the network that detects people for it."""

from __future__ import annotations

from dataclasses import dataclass, field

from panoptic_ros.detection.card import ModelCard


@dataclass(frozen=True, eq=False)
class DetectorModel:
    """Checked model card and the contents of its ONNX file.

    Args:
        person_detector: Network that detects the people for a family that works on crops. None: the whole
            image is one crop.
    """

    card: ModelCard
    onnx_bytes: bytes = field(repr=False)
    person_detector: DetectorModel | None = None
