"""Parameters of refinement."""

from __future__ import annotations

from dataclasses import dataclass

from panoptic_ros.params import Config, param


@dataclass(frozen=True, kw_only=True)
class RefinementConfig(Config):
    """Parameters of the smoothing of motion."""

    enabled: bool = param(True, doc="Off: skeletons pass through as tracking gave them, at once.")
    method: str = param(
        "smoother",
        choices=("smoother", "averaging"),
        doc="averaging is that of Joo et al. 2017, 6.3, over a whole recording (`--offline`) with the motion "
        "of the surface (`patches.active`); without these, skeletons pass through as tracking gave them.",
    )
    lag: float = param(
        0.12,
        unit="s",
        ge=0.0,
        le=10.0,
        doc="A result uses views up to this time after its instant, and waits for no others. If cameras are "
        "not synchronous and this is less than half a frame, results are for the instant of the newest view.",
        when="latency counts more than smoothness (0 to 0.05), or a recording is solved (0.3).",
    )
    process_noise: float = param(
        0.1,
        unit="m^2/s^3",
        ge=1e-3,
        le=1e4,
        doc="Spectral density of the acceleration of joints that move with the body: higher follows faster. "
        "A start; each person's is learnt online, from a tenth to ten times this.",
        when="fast motion is cut off, as in sports (1), or people hardly move and joints still shake (0.03).",
    )
    limb_noise: float = param(
        2.0,
        unit="1/s",
        ge=0.0,
        le=1e4,
        doc="How it grows with the squared speed of a joint against the body, the largest lately.",
    )
    acceleration_memory: float = param(
        0.05,
        unit="s",
        ge=0.0,
        le=10.0,
        doc="Time for which accelerations last, once the motion of the surface shows them; 0 = they are at "
        "random from instant to instant, as they are without patches.",
    )
    fading: float = param(
        0.4,
        ge=0.0,
        le=10.0,
        doc="Share of the lag, but at least 18 ms, over which a joint follows what later views tell of its "
        "place, while its surface shows how it moves.",
    )
    cauchy: float = param(
        3.0,
        unit="sigma",
        ge=0.5,
        le=100.0,
        doc="Scale of the Cauchy weight: the larger an innovation is, the less a measurement counts.",
    )
    start_speed: float = param(
        1.5,
        unit="m/s",
        ge=0.01,
        le=50.0,
        doc="Standard deviation of the velocity of a new joint.",
    )
    max_gap: float = param(
        0.3, unit="s", ge=0.0, le=10.0, doc="Longer gaps of a joint are not bridged; its motion starts anew."
    )
    max_prediction: float = param(
        0.2,
        unit="s",
        ge=0.0,
        le=10.0,
        doc="How long a joint of somebody who is seen is predicted when nothing came after.",
    )
    max_sigma: float = param(
        0.2,
        unit="m",
        ge=0.001,
        le=10.0,
        doc="Filled and predicted joints less certain than this are missing.",
    )
    bone_sigma: float = param(
        0.01,
        unit="m",
        ge=0.0,
        le=1.0,
        doc="Standard deviation by which bones differ from their learnt length; 0 = bones are not used.",
    )
    bone_frames: int = param(10, ge=1, le=100000, doc="Frames after which a learnt bone length is used.")
    lasting_share: float = param(
        0.5,
        ge=0.0,
        le=1.0,
        doc="Share of the variance of measurements whose errors last, as a limb that is hidden or taken for "
        "another stays so for many frames: smoothing does not remove it. Of detectors with biases only.",
    )
    difference_share: float = param(
        0.3,
        ge=0.0,
        le=10.0,
        doc="Share of their covariances by which the difference of two measurements of a joint errs, as most "
        "of their error lasts. It corrects the motion of the surface; 0 = it is not used.",
    )
    bias_floor: float = param(
        -1.0,
        unit="m",
        ge=-1.0,
        le=1.0,
        doc="Standard deviation added to every joint at the end for constant biases of the detector, which "
        "smoothing does not remove; negative = as its model card says (none without a card).",
    )
    bodies: bool = param(
        False,
        doc="Joints that two views or fewer see are mended by the bodies that kinematics solves; "
        "kinematics must run.",
    )
