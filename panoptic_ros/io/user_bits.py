"""Decode the date and time zone in the user bits of a timecode (SMPTE ST 309)."""

from __future__ import annotations

import datetime
from dataclasses import dataclass

ZONE_CODE, MODIFIED_JULIAN_DAY = 0x3F, 0x80  # bit masks of groups 7 and 8; 0x40 marks daylight saving time
FIRST_DAY = datetime.date(1858, 11, 17)
_RUNS = (  # first code, offset to UTC in minutes, step in minutes, number of codes
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
    """A date, and the offset of its time zone to UTC; None if the code is not an offset."""

    date: datetime.date
    zone: datetime.timedelta | None


def date_of(user_bits: int) -> DateAndZone | None:
    """Decode the date in user bits by SMPTE ST 309; None if they hold no date.

    Groups 1 to 6 hold day, month and year of the century, units first, or a modified Julian day of six
    digits. Groups 7 and 8 hold the zone; their highest bit selects the date format. Years below 67 are after
    2000.

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
