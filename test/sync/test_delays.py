"""Delays of timestamps, which may drift."""

import pytest

from panoptic_ros.domain import StampLine
from panoptic_ros.errors import ConfigError
from panoptic_ros.stamps.delays import NO_DELAY, delay_entry, delay_of, named_delays

START = 1_800_000_000_000_000_000


def test_a_delay_is_a_number_or_a_line():
    found = named_delays("x", ("cam1=8.3", f"cam2=-2.5,60,{START}", "*=4"))
    assert found["cam1"] == StampLine(0, 8_300_000) and delay_of(found, "other").offset_ns == 4_000_000
    assert delay_of(found, "cam2").corrected(START + 10**10) == START + 10**10 - 2_500_000 + 600_000
    assert delay_of({}, "cam1") == NO_DELAY


@pytest.mark.parametrize("line", [StampLine(0, 8_300_000), StampLine(START, -2_500_000, 6e-5)])
def test_an_entry_comes_back(line):
    assert named_delays("x", [delay_entry("cam1", line)])["cam1"] == line


@pytest.mark.parametrize("word", ["nan", "1,2", "1,2,x", "1,inf,3", "1,2,3,4", "ms"])
def test_other_words_are_refused(word):
    with pytest.raises(ConfigError, match="sync.delays_ms: .* of 'cam1' is not a number, nor ms,ppm,ref"):
        named_delays("sync.delays_ms", [f"cam1={word}"])
