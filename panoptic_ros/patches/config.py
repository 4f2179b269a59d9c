"""Parameters of patches."""

from __future__ import annotations

from dataclasses import dataclass

from panoptic_ros.params import Config, param


@dataclass(frozen=True, kw_only=True)
class PatchesConfig(Config):
    """Configuration of the measurement of part motions on the surface of people."""

    active: bool = param(
        False,
        doc="Measure the motion of people's surface between images, for refinement and for /patches.",
    )
    model_px: float = param(
        0.4,
        unit="px",
        ge=0.0,
        le=10.0,
        doc="Standard deviation of a point's motion from that of a rigid part, in addition to the 2D noise.",
    )
    turn_sigma: float = param(
        0.15,
        unit="rad",
        ge=0.001,
        le=10.0,
        doc="Standard deviation of a part's rotation between two instants from that of the skeleton.",
    )
    move_sigma: float = param(0.04, unit="m", ge=0.001, le=10.0, doc="The same for the part's translation.")
    correlation: float = param(
        4.0,
        ge=1.0,
        le=100.0,
        doc="Factor on the covariances of motions, as overlapping 2D tracks are not independent.",
    )
    fewest: int = param(
        6,
        ge=3,
        le=1000,
        doc="Least number of tracks that must agree with the motion of a part. A part with fewer has no "
        "motion.",
    )
    carry: float = param(
        1.0,
        unit="s",
        ge=0.0,
        le=60.0,
        doc="Longest time for which a joint that no view measures is propagated by the motion of its "
        "parts, to keep the patches there.",
    )
    carry_gain: float = param(
        0.3,
        ge=0.0,
        le=1.0,
        doc="Gain with which the skeleton that carries the patches follows a measured joint; less if the "
        "joint is far off. 1 = it takes the measured position.",
    )
    per_part: int = param(
        15,
        ge=0,
        le=1000,
        doc="Number of patches that are kept on each part of a person; twice as many on the torso.",
    )
    life: int = param(
        8,
        ge=1,
        le=1000,
        doc="Number of instants after which a patch ends. After ten or so, patches drift as far as joints "
        "err.",
    )
