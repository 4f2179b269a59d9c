"""Parameters of patches."""

from __future__ import annotations

from dataclasses import dataclass

from panoptic_ros.params import Config, param


@dataclass(frozen=True, kw_only=True)
class PatchesConfig(Config):
    """Configuration of the measurement of part motions on the surface of people."""

    active: bool = param(
        False,
        doc="Measure motion between images on people's surface, for refinement and for /patches.",
    )
    model_px: float = param(
        0.4,
        unit="px",
        ge=0.0,
        le=10.0,
        doc="Standard deviation by which a point on a part moves unlike a rigid part, besides the 2D noise.",
    )
    turn_sigma: float = param(
        0.15,
        unit="rad",
        ge=0.001,
        le=10.0,
        doc="Standard deviation of a part's rotation between two instants from that of the skeleton.",
    )
    move_sigma: float = param(0.04, unit="m", ge=0.001, le=10.0, doc="The same of its translation.")
    correlation: float = param(
        4.0,
        ge=1.0,
        le=100.0,
        doc="By how much covariances of motions are larger than if 2D tracks did not overlap.",
    )
    fewest: int = param(
        6, ge=3, le=1000, doc="Tracks that must agree with the motion of a part; of fewer, it has none."
    )
    carry: float = param(
        1.0,
        unit="s",
        ge=0.0,
        le=60.0,
        doc="A joint that no view measures is carried on by its parts for so long, for its part's patches.",
    )
    carry_gain: float = param(
        0.3,
        ge=0.0,
        le=1.0,
        doc="Share of the way to a measured joint by which the skeleton that patches are put on follows it; "
        "less if it is far off. 1 = it is taken as it is.",
    )
    per_part: int = param(
        15, ge=0, le=1000, doc="Patches that are kept on each part of a person, twice as many on the torso."
    )
    life: int = param(
        8,
        ge=1,
        le=1000,
        doc="Instants after which a patch ends: past ten or so they drift as far as joints err.",
    )
