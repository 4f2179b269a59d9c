"""The clock of a camera from the stamps of its frames."""

import numpy as np
import pytest

from panoptic_ros.clocks.report import measure_frames
from panoptic_ros.errors import DataError

START = 1_700_000_000_000_000_000


def stamps(rate=30.0, count=900, drift=0.0, delay=None, lost=()):
    frames = np.array([k for k in range(count) if k not in set(lost)])
    times = frames / rate * (1 + drift)
    if delay is not None:
        times = times + delay(len(frames))
    return [START + round(1e9 * t) for t in times], frames


def test_rate_and_drops_without_jitter():
    found, frames = stamps(29.97, lost=[5, 100, 101, 102, 400])
    timing = measure_frames(found)
    assert timing.rate_hz == pytest.approx(29.97, abs=1e-7)
    assert (timing.lost, timing.gaps, timing.not_later) == (5, 3, 0)
    assert (timing.counts == frames).all() and np.abs(timing.errors_s).max() < 2e-9


def test_late_stamps_and_bursts_of_drops():
    rng = np.random.default_rng(4)

    def late(count):
        return rng.gamma(2.0, 7e-4, count) + (rng.random(count) < 0.05) * rng.uniform(2e-3, 15e-3, count)

    lost = [*range(200, 212), 300, 301, 500]
    found, frames = stamps(30.0, 1800, 60e-6, late, lost)
    timing = measure_frames(found)
    assert timing.one_way and timing.lost == 15 and timing.gaps == 3
    assert timing.rate_hz == pytest.approx(30.0 * (1 - 60e-6), abs=2e-4)
    assert abs(timing.rate_hz - 30.0 * (1 - 60e-6)) < 4 * timing.rate_std_hz
    assert timing.errors_s.min() > -1e-3 and (timing.counts == frames).all()


def test_symmetric_jitter_is_averaged():
    rng = np.random.default_rng(5)
    found, _ = stamps(25.0, delay=lambda n: 1e-3 * rng.standard_normal(n))
    timing = measure_frames(found)
    assert not timing.one_way and timing.jitter_s == pytest.approx(1e-3, rel=0.15)
    assert abs(timing.errors_s.mean()) < 1e-4


def test_numbers_of_the_device_count_what_stamps_do_not_show():
    found, _ = stamps(count=100)
    numbers = [k + (k >= 50) for k in range(100)]
    assert measure_frames(found, numbers).lost == 1 and measure_frames(found).lost == 0


def test_stamps_that_stand_still_are_counted_and_left_out():
    found, _ = stamps(count=50)
    timing = measure_frames([*found[:20], found[19], found[10], *found[20:]])
    assert timing.not_later == 2 and timing.lost == 0
    with pytest.raises(DataError, match="2 frames"):
        measure_frames(found[:2])
