"""Parameters of the kinematics stage."""

from __future__ import annotations

from dataclasses import dataclass

from panoptic_ros.params import Config, param


@dataclass(frozen=True, kw_only=True)
class KinematicsConfig(Config):
    """Parameters of the kinematics stage.

    Weights are stated as standard deviations. Those of the paper are in the preset malleson-2020.
    """

    subjects: tuple[str, ...] = param(
        (), doc="Files of the designated people; `panoptic run --subject FILE` gives them."
    )
    everybody: bool = param(
        False, doc="Bodies of all who are tracked, whose lengths are taken from their first skeletons."
    )
    segments: str = param("segments21", doc="Skeleton of segments: an installed one, or a YAML file.")
    prior: str = param("", doc="File of a pose prior, of `panoptic prior train`; empty = the installed one.")
    offsets: str = param(
        "",
        doc="File of where the detector sees joints, of `panoptic bias measure --segments`; empty = "
        "where the skeleton of segments has them. Offsets in the file of a subject count more.",
    )
    rate_hz: float = param(60.0, unit="Hz", ge=5.0, le=240.0, doc="Rate of the poses.")
    lag: float = param(
        0.1, unit="s", ge=0.0, le=0.2, doc="Delay of the poses, over which later data smooth them."
    )
    window: bool = param(
        True, doc="Filter over time; without it every instant is solved alone, as in the paper."
    )
    joint_sd: float = param(
        0.048,
        unit="m",
        ge=0.001,
        le=1.0,
        doc="Error of a 2D joint of score 1, as a length at its depth, until it is learnt.",
    )
    noise_level: bool = param(
        True,
        doc="Learn from a person's residuals how large errors of 2D joints are: a quarter of what is "
        "assumed, to four times of it.",
    )
    score_power: float = param(
        2.0, ge=0.0, le=4.0, doc="The weight of a 2D joint is its score to this power."
    )
    joint_scale: float = param(
        5.4, ge=0.0, le=100.0, doc="Scale of Cauchy's loss of 2D joints, in standard deviations; 0 = none."
    )
    orientation_sd: float = param(
        3.0,
        unit="deg",
        ge=0.1,
        le=180.0,
        doc="Error of an IMU's orientation, where mounting is not estimated.",
    )
    turn_sd: float = param(
        30.0,
        unit="deg",
        ge=0.01,
        le=1000.0,
        doc="Error of how far an IMU turned within a second, which grows with the root of time.",
    )
    acceleration_sd: float = param(
        2.0, unit="m/s^2", ge=0.01, le=1000.0, doc="Error of an IMU's acceleration."
    )
    acceleration_scale: float = param(
        3.0, ge=0.0, le=100.0, doc="Scale of Cauchy's loss of accelerations, in standard deviations."
    )
    root_acceleration: float = param(
        8.0, unit="m/s^2", ge=0.1, le=1000.0, doc="Usual acceleration of the root, per axis."
    )
    joint_acceleration: float = param(
        60.0, unit="rad/s^2", ge=1.0, le=10000.0, doc="Usual acceleration of a joint, per axis."
    )
    error_time: float = param(
        0.2,
        unit="s",
        ge=0.01,
        le=1000.0,
        doc="Time for which errors of joints and orientations stay the same: that much data count once.",
    )
    lasting_share: float = param(
        0.5,
        ge=0.0,
        le=1.0,
        doc="Share of the variance of these errors that lasts longer; what bodies say of their own errors "
        "rests on it.",
    )
    prior_sd: float = param(
        12.0,
        unit="deg",
        ge=0.1,
        le=1000.0,
        doc="How far poses lie off the space of the prior, per axis, at most; less where they hardly vary.",
    )
    deviation_sd: float = param(
        1.3, ge=0.01, le=1000.0, doc="How far poses lie from the mean inside of it, in its deviations."
    )
    prior_scale: float = param(
        5.4, ge=0.0, le=100.0, doc="Scale of Cauchy's loss of the prior, in standard deviations; 0 = none."
    )
    hinge_sd: float = param(
        5.0,
        unit="deg",
        ge=0.1,
        le=1000.0,
        doc="How far forearms and shins leave the plane in which elbows and knees bend.",
    )
    limit_sd: float = param(5.0, unit="deg", ge=0.1, le=1000.0, doc="How far joints go beyond their limits.")
    mounting: bool = param(True, doc="Keep the mounting of IMUs uncertain and estimate it.")
    mounting_sd: float = param(
        3.0, unit="deg", ge=0.1, le=90.0, doc="Error of a mounting from a T-pose or a file, per axis."
    )
    strap_sd: float = param(
        2.0, unit="deg", ge=0.1, le=90.0, doc="Error of an IMU's orientation that changes in time, per axis."
    )
    heading_sd: float = param(
        2.0, unit="deg", ge=0.01, le=180.0, doc="Error of the common heading of the IMUs."
    )
    looks: float = param(
        2.0,
        ge=0.1,
        le=100.0,
        doc="Independent looks at constant errors: for so many instants all of a recording counts.",
    )
    lengths: bool = param(
        True, doc="Learn the lengths of subjects that state none from the joints that are seen."
    )
    clocks: bool = param(True, doc="Find the offset of the IMUs' clock from the cameras' by motion.")
    gate: float = param(0.5, unit="m", ge=0.05, le=5.0, doc="A 2D person farther off is somebody else.")
    iterations: int = param(3, ge=1, le=50, doc="At most, per instant.")
    paper_weights: bool = param(
        False, doc="The weights of Malleson et al. 2020 (3.2.6) in place of standard deviations."
    )
    paper_sorting: bool = param(
        False,
        doc="2D people are sorted to subjects by all pairs of views, algorithm 1 of the paper, in "
        "recordings; else by where bodies are expected.",
    )
    paper_acceleration: float = param(
        0.0,
        ge=0.0,
        le=1.0,
        doc="Weight of the paper's acceleration term, eq. 13; its own 1e-3 is far too much here.",
    )

    @property
    def runs(self) -> bool:
        """Return whether there are people to solve for."""
        return bool(self.subjects) or self.everybody
