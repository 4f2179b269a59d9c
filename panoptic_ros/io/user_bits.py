"""The date and zone that the user bits of a timecode may hold (SMPTE ST 309)."""

from __future__ import annotations

import datetime
from dataclasses import dataclass

ZONE_CODE, MODIFIED_JULIAN_DAY = 0x3F, 0x80  # bits of groups 7 and 8; 0x40 is summer time
FIRST_DAY = datetime.date(1858, 11, 17)
_RUNS = (  # first code, minutes ahead of UTC, step, number of codes
    (0x00, 0, -60, 10),
    (0x0A, -30, -60, 6),
    (0x10, -600, -60, 3),
    (0x13, 780, -60, 7),
    (0x1A, -390, -60, 6),
    (0x20, 360, -60, 6),
    (0x2A, 690, -60, 6),
    (0x32, 765, 0, 1),
    (0x3A, 330, -60, 6),
)
ZONES = {code + k: ahead + step * k for code, ahead, step, count in _RUNS for k in range(count)}


@dataclass(frozen=True, slots=True)
class DateAndZone:
    """A day, and what a clock there is ahead of UTC; None if the code says something else."""

    date: datetime.date
    zone: datetime.timedelta | None


def date_of(user_bits: int) -> DateAndZone | None:
    """The date in user bits by SMPTE ST 309; None if they are no date.

    Groups 1 to 6 hold day, month and year of the century, units first, or a modified Julian day of six
    digits; groups 7 and 8 the zone, the highest bit telling the format. Years below 67 are after 2000.

    Args:
        user_bits: 32 bits, group 1 in the lowest four.
    """
    digits = [(user_bits >> (4 * group)) & 15 for group in range(6)]
    if max(digits) > 9:
        return None
    code = (user_bits >> 24) & 0xFF
    if code & MODIFIED_JULIAN_DAY:
        days = sum(digit * 10**k for k, digit in enumerate(digits))
        return DateAndZone(FIRST_DAY + datetime.timedelta(days=days), _zone(code))
    day, month, year = (digits[k] + 10 * digits[k + 1] for k in (0, 2, 4))
    try:
        date = datetime.date(year + (2000 if year < 67 else 1900), month, day)
    except ValueError:
        return None
    return DateAndZone(date, _zone(code))


def _zone(code: int) -> datetime.timedelta | None:
    minutes = ZONES.get(code & ZONE_CODE)
    return None if minutes is None else datetime.timedelta(minutes=minutes)
