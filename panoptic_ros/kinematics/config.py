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
        (), doc="Files of the designated people; `panoptic run --subject FILE` sets them."
    )
    everybody: bool = param(
        False, doc="Solve bodies of all tracked people, with lengths from their first skeletons."
    )
    segments: str = param("segments21", doc="Skeleton of segments: an installed one, or a YAML file.")
    prior: str = param("", doc="Pose prior, a file of `panoptic prior train`; empty = the installed one.")
    offsets: str = param(
        "",
        doc="Positions of the detector's joints on the segments, a file of `panoptic bias measure "
        "--segments`; empty = positions of the skeleton of segments. Offsets in the file of a subject "
        "take precedence.",
    )
    rate_hz: float = param(60.0, unit="Hz", ge=5.0, le=240.0, doc="Rate of the poses.")
    lag: float = param(
        0.1, unit="s", ge=0.0, le=0.2, doc="Delay of the poses, over which later data smooth them."
    )
    window: bool = param(True, doc="Filter over time. Off: every instant is solved alone, as in the paper.")
    joint_sd: float = param(
        0.048,
        unit="m",
        ge=0.001,
        le=1.0,
        doc="Standard deviation of a 2D joint of score 1, as a length at its depth, until it is learnt.",
    )
    noise_level: bool = param(
        True,
        doc="Learn the size of errors of 2D joints from a person's residuals: from a quarter of the "
        "assumed size to four times of it.",
    )
    score_power: float = param(2.0, ge=0.0, le=4.0, doc="Exponent of the score of a 2D joint in its weight.")
    joint_scale: float = param(
        5.4,
        ge=0.0,
        le=100.0,
        doc="Scale of the Cauchy loss of 2D joints, in standard deviations; 0 = no Cauchy loss.",
    )
    orientation_sd: float = param(
        3.0,
        unit="deg",
        ge=0.1,
        le=180.0,
        doc="Standard deviation of an IMU's orientation if its mounting is not estimated.",
    )
    turn_sd: float = param(
        30.0,
        unit="deg",
        ge=0.01,
        le=1000.0,
        doc="Standard deviation of an IMU's rotation within one second; it grows with the square root of "
        "time.",
    )
    acceleration_sd: float = param(
        2.0, unit="m/s^2", ge=0.01, le=1000.0, doc="Standard deviation of an IMU's acceleration."
    )
    acceleration_scale: float = param(
        3.0, ge=0.0, le=100.0, doc="Scale of the Cauchy loss of accelerations, in standard deviations."
    )
    root_acceleration: float = param(
        8.0, unit="m/s^2", ge=0.1, le=1000.0, doc="Typical acceleration of the root, per axis."
    )
    joint_acceleration: float = param(
        60.0, unit="rad/s^2", ge=1.0, le=10000.0, doc="Typical acceleration of a joint, per axis."
    )
    error_time: float = param(
        0.2,
        unit="s",
        ge=0.01,
        le=1000.0,
        doc="Time for which errors of joints and orientations stay the same. All data within it count as "
        "one measurement.",
    )
    lasting_share: float = param(
        0.5,
        ge=0.0,
        le=1.0,
        doc="Persistent share of the variance of these errors. The covariances of bodies depend on it.",
    )
    prior_sd: float = param(
        12.0,
        unit="deg",
        ge=0.1,
        le=1000.0,
        doc="Greatest standard deviation of poses from the space of the prior, per axis; less for axes "
        "that hardly vary.",
    )
    deviation_sd: float = param(
        1.3,
        ge=0.01,
        le=1000.0,
        doc="Standard deviation of poses from the mean within that space, in the prior's own standard "
        "deviations.",
    )
    prior_scale: float = param(
        5.4,
        ge=0.0,
        le=100.0,
        doc="Scale of the Cauchy loss of the prior, in standard deviations; 0 = no Cauchy loss.",
    )
    hinge_sd: float = param(
        5.0,
        unit="deg",
        ge=0.1,
        le=1000.0,
        doc="Standard deviation of forearms and shins from the plane in which elbows and knees bend.",
    )
    limit_sd: float = param(
        5.0, unit="deg", ge=0.1, le=1000.0, doc="Standard deviation of joints beyond their limits."
    )
    mounting: bool = param(True, doc="Treat the mounting of IMUs as uncertain and estimate it.")
    mounting_sd: float = param(
        3.0,
        unit="deg",
        ge=0.1,
        le=90.0,
        doc="Standard deviation of a mounting from a T-pose or a file, per axis.",
    )
    strap_sd: float = param(
        2.0,
        unit="deg",
        ge=0.1,
        le=90.0,
        doc="Standard deviation of the part of an IMU's orientation error that changes over time, per axis.",
    )
    heading_sd: float = param(
        2.0, unit="deg", ge=0.01, le=180.0, doc="Standard deviation of the common heading of the IMUs."
    )
    looks: float = param(
        2.0,
        ge=0.1,
        le=100.0,
        doc="Number of independent instants that a whole recording counts as in the estimation of "
        "constant errors.",
    )
    lengths: bool = param(
        True, doc="Learn the lengths of subjects without stated lengths from their visible joints."
    )
    clocks: bool = param(
        True, doc="Estimate the offset between the IMUs' clock and the cameras' clock from motion."
    )
    gate: float = param(
        0.5,
        unit="m",
        ge=0.05,
        le=5.0,
        doc="Distance from the expected body beyond which a 2D person is another person.",
    )
    iterations: int = param(3, ge=1, le=50, doc="Greatest number of iterations per instant.")
    paper_weights: bool = param(
        False, doc="Use the weights of Malleson et al. 2020 (3.2.6) instead of standard deviations."
    )
    paper_sorting: bool = param(
        False,
        doc="In recordings, assign 2D people to subjects by all pairs of views, algorithm 1 of the paper. "
        "Off: by the predicted positions of bodies.",
    )
    paper_acceleration: float = param(
        0.0,
        ge=0.0,
        le=1.0,
        doc="Weight of the paper's acceleration term, eq. 13. The paper's own 1e-3 is far too large here.",
    )

    @property
    def runs(self) -> bool:
        """Return whether there are people to solve for."""
        return bool(self.subjects) or self.everybody
