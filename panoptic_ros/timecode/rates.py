"""Which rate a timecode has, by its way of counting and by the length of its words."""
from __future__ import annotations

import math
from collections.abc import Collection
from fractions import Fraction

from panoptic_ros.domain import FrameRate, Timecode
from panoptic_ros.errors import ClockError
from panoptic_ros.timecode.words import DROP_RATE

RATES = (
    FrameRate(24, Fraction(24000, 1001)), FrameRate(24, Fraction(24)), FrameRate(25, Fraction(25)),
    FrameRate(30, Fraction(30000, 1001)), FrameRate(30, Fraction(30)),
)  # fmt: skip


EXACT = [float(rate.exact) for rate in RATES]


def closest_rate(countings: Collection[FrameRate], measured: float) -> FrameRate:
    """The rate among those that count in one of some ways that is closest to words per second."""
    nominals = {rate.nominal for rate in countings if not rate.drop_frame}
    possible = [(rate, exact) for rate, exact in zip(RATES, EXACT) if rate.nominal in nominals]
    if any(rate.drop_frame for rate in countings):
        possible.append((DROP_RATE, float(DROP_RATE.exact)))
    if len(possible) == 1:
        return possible[0][0]
    return min(possible, key=lambda item: abs(math.log(measured / item[1])))[0]


def with_rate(label: Timecode, rate: FrameRate) -> Timecode:
    """The same label at another rate that has it, else as it is."""
    try:
        return Timecode(label.hours, label.minutes, label.seconds, label.frames, rate)
    except ClockError:
        return label
