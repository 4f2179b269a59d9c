"""Options of the preset."""

from __future__ import annotations

from dataclasses import dataclass

from panoptic_ros.continuous.config import ContinuousConfig


@dataclass(frozen=True, slots=True)
class ElhayekConfig:
    """Options of the pass.

    Args:
        continuous: options of the pass that follows the people and gives clocks and first poses.
        keypoints: use the 2D joints as a term of the energy.
        images: use the images as a term of the energy.
    """

    continuous: ContinuousConfig = ContinuousConfig()
    keypoints: bool = True
    images: bool = False
