"""Which rate a timecode has, by its way of counting and by the length of its words."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from fractions import Fraction

from panoptic_ros.domain import FrameRate, Timecode
from panoptic_ros.errors import ClockError
from panoptic_ros.timecode.word.layout import DROP_RATE

RATES = (
    FrameRate(24, Fraction(24000, 1001)),
    FrameRate(24, Fraction(24)),
    FrameRate(25, Fraction(25)),
    FrameRate(30, Fraction(30000, 1001)),
    FrameRate(30, Fraction(30)),
)


def possible_rates(countings: Collection[FrameRate]) -> list[tuple[FrameRate, float]]:
    """The rates that count in one of some ways, and their words per second."""
    nominals = {rate.nominal for rate in countings if not rate.drop_frame}
    rates = [rate for rate in RATES if rate.nominal in nominals]
    if any(rate.drop_frame for rate in countings):
        rates.append(DROP_RATE)
    return [(rate, float(rate.exact)) for rate in rates]


def closest_rate(rates: Sequence[tuple[FrameRate, float]], measured: float) -> FrameRate:
    """The rate of some that is closest to words per second."""
    if len(rates) == 1:
        return rates[0][0]
    return min(rates, key=lambda item: abs(math.log(measured / item[1])))[0]


def with_rate(label: Timecode, rate: FrameRate) -> Timecode:
    """The same label at another rate that has it, else as it is."""
    try:
        return Timecode(label.hours, label.minutes, label.seconds, label.frames, rate)
    except ClockError:
        return label
