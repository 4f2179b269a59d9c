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
        doc="Length of the window of readings; longer is more precise, shorter follows a warming crystal.",
    )
    least_span_s: float = param(
        1.0, unit="s", ge=0.1, le=60.0, doc="Span of readings before the first model of a device is given."
    )
    period_s: float = param(0.25, unit="s", ge=0.0, le=60.0, doc="Time between two models of a device.")
    jump_s: float = param(
        0.02,
        unit="s",
        ge=1e-4,
        le=10.0,
        doc="Distance from the line beyond which a reading is left out, or a jump if others agree with it. "
        "Where stamps scatter little, eight times their scatter counts instead.",
    )
    jump_words: int = param(
        3, ge=2, le=10, doc="Consecutive readings off the line, on a line of their own, that make a jump."
    )
    stamps: str = param(
        "auto",
        choices=("auto", "symmetric", "one-way"),
        doc="How stamps err: symmetric errors are averaged; one-way stamps are late by a transport delay, "
        "and the line lies under them. auto: one-way if stamps are late more than early.",
    )
    delays_ms: tuple[str, ...] = param(
        (),
        unit="ms",
        doc='How much later than its true instant a device stamps the sound, as "device=milliseconds" '
        '(delay of the line, of the sound in air, of filters); "*" stands for all others.',
        when="timecode reaches a device late: 3 ms for each metre through air, or what a test showed.",
    )
    wander_ppm: float = param(
        0.5,
        unit="ppm",
        ge=0.0,
        le=1000.0,
        doc="How far the rate of a device may wander while nothing is heard; its uncertainty grows by that.",
    )

    master_clock: str = param(
        "",
        doc="Of clocks that are named for their timecode, the one whose time the master time is; empty: the "
        "first that is heard. Unless given, that of sync.",
    )

    def __post_init__(self) -> None:
        Config.__post_init__(self)
        named_numbers("ClocksConfig.delays_ms", self.delays_ms)
