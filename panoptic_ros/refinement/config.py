"""Parameters of refinement."""

from __future__ import annotations

from dataclasses import dataclass

from panoptic_ros.params import Config, param


@dataclass(frozen=True, kw_only=True)
class RefinementConfig(Config):
    """Parameters of the smoothing of motion."""

    enabled: bool = param(
        True, doc="Refine skeletons. Off: skeletons of tracking pass through unchanged, at once."
    )
    method: str = param(
        "smoother",
        choices=("smoother", "averaging"),
        doc="smoother: Kalman smoother with the lag below. averaging: method of Joo et al. 2017, 6.3, "
        "over a whole recording (`--offline`) with the motion of the surface (`patches.active`); without "
        "these, skeletons of tracking pass through unchanged.",
    )
    lag: float = param(
        0.12,
        unit="s",
        ge=0.0,
        le=10.0,
        doc="Time after its instant up to which a result uses views; it waits for no others. If cameras "
        "are not synchronous and the lag is less than half a frame, results are for the instant of the "
        "newest view.",
        when="latency counts more than smoothness (0 to 0.05), or a recording is solved (0.3).",
    )
    process_noise: float = param(
        0.1,
        unit="m^2/s^3",
        ge=1e-3,
        le=1e4,
        doc="Spectral density of the acceleration of joints that move with the body; a higher value "
        "follows faster. It is the start: each person's value is learnt online, from a tenth to ten times "
        "this.",
        when="fast motion is cut off, as in sports (1), or people hardly move and joints still shake (0.03).",
    )
    limb_noise: float = param(
        2.0,
        unit="1/s",
        ge=0.0,
        le=1e4,
        doc="Growth of the process noise with the squared speed of a joint relative to the body; its "
        "largest recent speed counts.",
    )
    acceleration_memory: float = param(
        0.05,
        unit="s",
        ge=0.0,
        le=10.0,
        doc="Correlation time of accelerations once patches measure the motion of the surface; 0 = white "
        "noise, as without patches.",
    )
    fading: float = param(
        0.4,
        ge=0.0,
        le=10.0,
        doc="Share of the lag, but at least 18 ms, over which a joint follows corrections of its position "
        "by later views, while its surface shows its motion.",
    )
    cauchy: float = param(
        3.0,
        unit="sigma",
        ge=0.5,
        le=100.0,
        doc="Scale of the Cauchy weight: the larger an innovation, the less a measurement counts.",
    )
    start_speed: float = param(
        1.5,
        unit="m/s",
        ge=0.01,
        le=50.0,
        doc="Standard deviation of the velocity of a new joint.",
    )
    max_gap: float = param(
        0.3,
        unit="s",
        ge=0.0,
        le=10.0,
        doc="Longest gap of a joint that is bridged. After a longer gap, its motion starts again.",
    )
    max_prediction: float = param(
        0.2,
        unit="s",
        ge=0.0,
        le=10.0,
        doc="Longest time for which a joint without later measurements is predicted, for a person who is "
        "still seen.",
    )
    max_sigma: float = param(
        0.2,
        unit="m",
        ge=0.001,
        le=10.0,
        doc="Standard deviation above which filled and predicted joints are missing.",
    )
    bone_sigma: float = param(
        0.01,
        unit="m",
        ge=0.0,
        le=1.0,
        doc="Standard deviation of bones from their learnt length; 0 = bones are not used.",
    )
    bone_frames: int = param(10, ge=1, le=100000, doc="Frames after which a learnt bone length is used.")
    lasting_share: float = param(
        0.5,
        ge=0.0,
        le=1.0,
        doc="Persistent share of the variance of measurements, which smoothing does not remove: a hidden "
        "or confused limb stays so for many frames. Only for detectors with biases.",
    )
    difference_share: float = param(
        0.3,
        ge=0.0,
        le=10.0,
        doc="Covariance of the difference of two measurements of a joint, as a share of the sum of their "
        "covariances; most of their error persists and cancels. The difference corrects the motion of the "
        "surface; 0 = it is not used.",
    )
    bias_floor: float = param(
        -1.0,
        unit="m",
        ge=-1.0,
        le=1.0,
        doc="Standard deviation added to every joint at the end for constant biases of the detector, "
        "which smoothing does not remove; negative = value of the model card (none without a card).",
    )
    bodies: bool = param(
        False,
        doc="Correct joints that two views or fewer see by the bodies that kinematics solves; kinematics "
        "must run.",
    )
