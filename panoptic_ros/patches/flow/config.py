"""Parameters of flow."""

from __future__ import annotations

from dataclasses import dataclass

from panoptic_ros.params import Config, param


@dataclass(frozen=True, kw_only=True)
class FlowConfig(Config):
    """Configuration of the optical-flow tracking of points on people."""

    width: int = param(
        960,
        unit="px",
        ge=160,
        le=8192,
        doc="Image width above which images are downscaled to this width. Motion is then measured faster, "
        "but less exactly.",
    )
    views: int = param(
        8,
        ge=0,
        le=480,
        doc="Views that track all points on a person. If more views see the person, each tracks a share, "
        "so that a person costs the same in rigs of any size. 0 = every view tracks all points.",
    )
    longest_gap: float = param(
        0.15,
        unit="s",
        ge=0.001,
        le=10.0,
        doc="Longest time between two images over which points are tracked.",
    )
