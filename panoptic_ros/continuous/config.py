"""Options of the continuous pass, and parameters of the continuous stage."""

from __future__ import annotations

from dataclasses import dataclass

from panoptic_ros.identity.returns import RETURN_S
from panoptic_ros.identity.subjects import subjects_of
from panoptic_ros.params import Config, named_words, param
from panoptic_ros.solving.capture_space import CAPTURE_VIEWS
from panoptic_ros.stamps.delays import named_delays

MOST_HZ = 1000.0  # Hz, highest rate of the online form


@dataclass(frozen=True, slots=True)
class ContinuousConfig:
    """Options of the pass.

    Args:
        clocks: estimate the clocks of the cameras.
        rolling_shutter: estimate their line delays.
        trusted_camera: (name) camera whose clock and line delay are right. "" = most clocks, or their mean.
        capture_views: number of cameras whose fields of view must contain a person, see
            `assembly.capture_views`.
    """

    clocks: bool = False
    rolling_shutter: bool = False
    trusted_camera: str = ""
    capture_views: int = CAPTURE_VIEWS


@dataclass(frozen=True, kw_only=True)
class ContinuousStageConfig(Config):
    """Parameters of the people at instants of a fixed rate, from views that are taken one by one."""

    active: bool = param(
        False,
        doc="Give the people at instants of a fixed rate (/skeletons_at), from views that are never grouped. "
        "It is for cameras that are not synchronised and slower than 25 Hz, and for stamps of other devices.",
    )
    rate_hz: float = param(
        50.0,
        unit="Hz",
        ge=0.1,
        le=MOST_HZ,
        doc="Rate of the instants, at multiples of its period on the master clock.",
    )
    lag: float = param(
        0.1,
        unit="s",
        ge=0.0,
        le=1.0,
        doc="Time after an instant up to which views are used for it. With 0.05 the error is a tenth larger, "
        "with 0 (prediction) two to three times as large.",
    )
    wait_s: float = param(
        0.0,
        unit="s",
        ge=0.0,
        le=1.0,
        doc="Live: longest time, in capture time, by which a view may arrive after later views of other "
        "cameras. Instants wait for it.",
    )
    capture_views: int = param(
        CAPTURE_VIEWS,
        ge=2,
        le=1000,
        doc="Cameras whose fields of view must contain a new person; the same as assembly.capture_views, "
        "which is the default.",
    )
    memory: float = param(
        RETURN_S,
        unit="s",
        ge=0.0,
        le=600.0,
        doc="Time for which the identity of a person who is not seen is kept; the same as tracking.memory, "
        "which is the default.",
    )
    recognition_time: float = param(
        0.6,
        unit="s",
        ge=0.0,
        le=10.0,
        doc="Longest time for which a newcomer who may be a lost person is observed; the same as "
        "tracking.recognition_time, which is the default.",
    )
    subjects: tuple[str, ...] = param(
        (), doc="Designated people; the same as tracking.subjects, which is the default."
    )
    bystanders: bool = param(
        False, doc="Report bystanders too; the same as tracking.bystanders, which is the default."
    )
    clocks: tuple[str, ...] = param(
        (), doc="Devices whose clocks stamp cameras; the same as sync.clocks, which is the default."
    )
    delays_ms: tuple[str, ...] = param(
        (), unit="ms", doc="Clock delays that are known; the same as sync.delays_ms, which is the default."
    )

    def __post_init__(self) -> None:
        Config.__post_init__(self)
        subjects_of(self.subjects, "ContinuousStageConfig.subjects")
        named_words("ContinuousStageConfig.clocks", self.clocks)
        named_delays("ContinuousStageConfig.delays_ms", self.delays_ms)
