"""Parameters of the clocks stage."""

from __future__ import annotations

from dataclasses import dataclass

from panoptic_ros.params import Config, named_numbers, param


@dataclass(frozen=True, kw_only=True)
class ClocksConfig(Config):
    """Parameters of the estimation of clock models from timecode."""

    window_s: float = param(
        20.0,
        unit="s",
        ge=1.0,
        le=600.0,
        doc="Length of the window of readings. A longer window is more precise; a shorter one follows a "
        "warming crystal.",
    )
    least_span_s: float = param(
        1.0, unit="s", ge=0.1, le=60.0, doc="Span of readings that the first model of a device needs."
    )
    period_s: float = param(0.25, unit="s", ge=0.0, le=60.0, doc="Time between two models of a device.")
    jump_s: float = param(
        0.02,
        unit="s",
        ge=1e-4,
        le=10.0,
        doc="Distance from the fitted line beyond which a reading is left out, or counts as a jump if "
        "others agree with it. If timestamps scatter little, the limit is eight times their scatter.",
    )
    jump_words: int = param(
        3,
        ge=2,
        le=10,
        doc="Consecutive readings off the line, but on one line of their own, that count as a jump.",
    )
    stamps: str = param(
        "auto",
        choices=("auto", "symmetric", "one-way"),
        doc="Error model of timestamps. symmetric: errors are averaged. one-way: timestamps are late by a "
        "transport delay, and the line lies below them. auto: one-way if timestamps are late more than "
        "early.",
    )
    delays_ms: tuple[str, ...] = param(
        (),
        unit="ms",
        doc="Delay from the true instant of the sound to its timestamp on a device, as "
        '"device=milliseconds" (delay of the line, of the sound in air, of filters); "*" applies to all '
        "other devices.",
        when="timecode reaches a device late: 3 ms for each metre through air, or the delay that a test "
        "showed.",
    )
    wander_ppm: float = param(
        0.5,
        unit="ppm",
        ge=0.0,
        le=1000.0,
        doc="Possible change of a device's clock rate while no timecode arrives. The uncertainty of its "
        "clock model grows by it.",
    )

    master_clock: str = param(
        "",
        doc="Clock, among those named for their timecode, that defines the master time; empty: the first "
        "one that is received. Unless given, it is sync.master_clock.",
    )

    def __post_init__(self) -> None:
        Config.__post_init__(self)
        named_numbers("ClocksConfig.delays_ms", self.delays_ms)
