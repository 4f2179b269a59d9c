"""Parameters of the sync stage."""

from __future__ import annotations

from dataclasses import dataclass

from panoptic_ros.params import Config, named_words, param
from panoptic_ros.stamps.delays import named_delays


@dataclass(frozen=True, kw_only=True)
class SyncConfig(Config):
    """Parameters for grouping frames of different cameras into sets."""

    master: str = param(
        "auto",
        doc="Camera that defines the rate and phase of the sets; auto: the fastest one, or the first of "
        "the rig among equally fast ones. Ignored if rate_hz is given.",
    )
    rate_hz: float = param(
        0.0,
        unit="Hz",
        ge=0.0,
        le=1000.0,
        doc="Fixed rate of the sets, at multiples of its period on the master clock; 0: rate of a camera.",
        when="cameras have several rates, or another instrument samples at a rate of its own.",
    )
    phase_s: float = param(
        0.0,
        unit="s",
        ge=-1.0,
        le=1.0,
        doc="Delay of sets of a fixed rate after the multiples of the period.",
    )
    window_s: float = param(
        0.0,
        unit="s",
        ge=0.0,
        le=1.0,
        doc="Greatest distance of a frame from the instant of its set. 0: 0.6 of the time between two "
        "sets, so that every set has the nearest frame of every camera.",
    )
    resampling: str = param(
        "nearest",
        choices=("nearest", "interpolate"),
        doc="Treatment of frames off the instant of a set. nearest: views keep their own timestamps, and "
        "later stages correct for them. interpolate: 2D people are linked between a camera's frames and "
        "interpolated at the instant, one frame later.",
    )
    deadline_s: float = param(
        0.0,
        unit="s",
        ge=0.0,
        le=10.0,
        doc="Live: longest time, in capture time, that a set waits for its last cameras. 0: it waits for "
        "all of them, without limit (replay).",
        when="cameras fail live, and half a second (the wait of a live graph) is too long: e.g. 0.1.",
    )
    minimum_views: int = param(
        1,
        ge=1,
        le=1000,
        doc="Least number of views of a set. Sets with fewer are dropped, and counted as sync.few_views.",
    )
    queue_limit: int = param(
        512,
        ge=2,
        le=100000,
        doc="Greatest number of waiting frames per camera; beyond it the oldest are dropped and counted.",
    )
    clocks: tuple[str, ...] = param(
        (),
        doc='Device whose clock stamps a camera\'s frames, as "camera=device"; "*=host" applies to all '
        "other cameras. Frames of these cameras wait for the model of that clock. Other cameras use a "
        "model of the clock that the rig names, or of their own name, if there is one.",
        when="timecode is in the sound of another device than the camera, and the rig does not name it.",
    )
    master_clock: str = param(
        "",
        doc="Clock, among those named for their timecode, that defines the master time; empty: the first "
        "that sound.yaml names.",
    )
    delays_ms: tuple[str, ...] = param(
        (),
        unit="ms",
        doc='Delay from a frame\'s timestamp to its mid-exposure, as "camera=milliseconds"; "*" applies to '
        'all other cameras. "camera=ms,ppm,reference_ns" drifts. '
        "Half the exposure if timestamps are of its start; negative if they are of "
        "arrivals.",
        when="timestamps are not of mid-exposure: half the exposure, or the delay that "
        "`--offsets-from-motion` found.",
    )

    def __post_init__(self) -> None:
        Config.__post_init__(self)
        named_words("SyncConfig.clocks", self.clocks)
        named_delays("SyncConfig.delays_ms", self.delays_ms)
