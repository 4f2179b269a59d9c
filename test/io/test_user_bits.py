"""Dates and zones in user bits, by hand."""

from __future__ import annotations

import datetime

import pytest

from panoptic_ros.io.user_bits import date_of


@pytest.mark.parametrize(
    ("bits", "date", "minutes"),
    [
        (0x00261107, (2026, 11, 7), 0),
        (0x25261107, (2026, 11, 7), 60),
        (0x05991231, (1999, 12, 31), -300),
        (0x3A000229, (2000, 2, 29), 330),
        (0x0F660101, (2066, 1, 1), -330),
        (0x32670101, (1967, 1, 1), 765),
        (0x80051544, (2000, 1, 1), 0),
    ],
)
def test_dates(bits: int, date: tuple[int, int, int], minutes: int) -> None:
    found = date_of(bits)
    assert found is not None
    assert found.date == datetime.date(*date) and found.zone == datetime.timedelta(minutes=minutes)


@pytest.mark.parametrize("bits", [0x00000000, 0x12ABCDEF, 0x00261307, 0x00260230])
def test_what_is_no_date(bits: int) -> None:
    assert date_of(bits) is None


def test_an_unknown_zone() -> None:
    found = date_of(0x38261107)
    assert found is not None and found.zone is None
