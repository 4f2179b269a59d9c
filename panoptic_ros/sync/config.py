"""Parameters of the sync stage."""

from __future__ import annotations

from dataclasses import dataclass

from panoptic_ros.params import Config, named_numbers, named_words, param


@dataclass(frozen=True, kw_only=True)
class SyncConfig(Config):
    """Parameters for grouping frames of different cameras into sets."""

    master: str = param(
        "auto",
        doc="The camera whose rate and phase the sets have; auto: the fastest one, or the first of the rig "
        "among equally fast ones. Has no meaning if rate_hz is given.",
    )
    rate_hz: float = param(
        0.0,
        unit="Hz",
        ge=0.0,
        le=1000.0,
        doc="Sets at this fixed rate, at multiples of its period on the master clock; 0: those of a camera.",
        when="cameras have several rates, or an instrument beside them samples at a rate of its own.",
    )
    phase_s: float = param(
        0.0,
        unit="s",
        ge=-1.0,
        le=1.0,
        doc="How much later sets of a fixed rate are than multiples of the period.",
    )
    window_s: float = param(
        0.0,
        unit="s",
        ge=0.0,
        le=1.0,
        doc="Frames at most this far from an instant belong to its set; 0: 0.6 of the time between two sets, "
        "so that every camera has its nearest frame in it.",
    )
    resampling: str = param(
        "nearest",
        choices=("nearest", "interpolate"),
        doc="nearest: views keep their own stamps, and later stages allow for them. interpolate: 2D people "
        "are linked between a camera's frames and moved to the instant, a frame later.",
    )
    deadline_s: float = param(
        0.0,
        unit="s",
        ge=0.0,
        le=10.0,
        doc="Live: how long, in capture time, a set waits for its last cameras. "
        "0 waits for all of them, however long (replay).",
        when="live, half a second (what a live graph waits) is too long where cameras fail: e.g. 0.1.",
    )
    minimum_views: int = param(
        1, ge=1, le=1000, doc="Sets of fewer views are dropped, and counted as sync.few_views."
    )
    queue_limit: int = param(
        512,
        ge=2,
        le=100000,
        doc="Most frames that wait per camera; beyond it the oldest are dropped and counted.",
    )
    clocks: tuple[str, ...] = param(
        (),
        doc='Whose clock stamps a camera\'s frames, as "camera=device"; "*=host": all others. Frames '
        "of these cameras wait for the model of that clock; others use a model of the clock that the rig "
        "names, or of their own name, if any.",
        when="timecode comes on the sound of another device than the camera, and the rig does not say so.",
    )
    master_clock: str = param(
        "",
        doc="Of clocks that are named for their timecode, the one whose time the master time is; empty: the "
        "first that sound.yaml names.",
    )
    delays_ms: tuple[str, ...] = param(
        (),
        unit="ms",
        doc='How much later than its stamp a frame\'s mid-exposure is, as "camera=milliseconds" (half the '
        'exposure where stamps are of its start; negative where they are of arrivals); "*": all others.',
        when="stamps are not of mid-exposure: half the exposure, or what `--offsets-from-motion` found.",
    )

    def __post_init__(self) -> None:
        Config.__post_init__(self)
        named_words("SyncConfig.clocks", self.clocks)
        named_numbers("SyncConfig.delays_ms", self.delays_ms)
