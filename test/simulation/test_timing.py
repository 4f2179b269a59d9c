"""Exposures and stamps."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from panoptic_ros.simulation import Timing
from panoptic_ros.simulation.timing import make_schedule, to_stamp


def test_cameras_in_step_expose_at_the_ticks():
    schedule = make_schedule([1], Timing(rate=25.0), 10, 3)
    assert np.allclose(schedule.exposures, np.arange(10)[:, None] / 25.0, atol=1e-12)
    assert (schedule.stamps == schedule.exposures).all()
    assert to_stamp(schedule.ticks[5]) == 1_200_000_000


def test_a_slower_camera_misses_sets():
    schedule = make_schedule([1], Timing(30.0, (30.0, 15.0)), 60, 2)
    there = ~np.isnan(schedule.exposures)
    assert there[:, 0].all() and there[:, 1].sum() == 30


@settings(max_examples=40, deadline=None)
@given(
    st.sampled_from([24.0, 25.0, 29.97, 30.0, 60.0]),
    st.floats(0.0, 0.02),
    st.floats(0.0, 100.0),
    st.integers(1, 40),
    st.integers(0, 99),
)
def test_every_exposure_is_nearest_to_its_set(rate, phase, drift, frames, seed):
    timing = Timing(30.0, (rate,), phase=phase, drift_ppm=drift)
    schedule = make_schedule([seed], timing, frames, 2)
    off = schedule.exposures - schedule.ticks[:, None]
    assert np.nanmax(np.abs(off), initial=0.0) <= 0.5 / 30.0 + 1e-9


def test_drift_jitter_and_drops():
    timing = Timing(30.0, drift_ppm=1000.0, stamp_jitter=0.001, drop=0.2)
    schedule = make_schedule([3], timing, 600, 4)
    there = ~np.isnan(schedule.exposures)
    assert 0.7 < there.mean() < 0.9
    assert 0.0009 < np.nanstd(schedule.stamps - schedule.exposures) < 0.0011
    assert np.nanmax(np.abs(schedule.exposures - schedule.ticks[:, None])) > 1e-4


def test_a_longer_schedule_begins_with_a_shorter_one():
    timing = Timing(29.97, (25.0, 29.97), 0.02, 30.0, 0.001, 0.1)
    short, long = (make_schedule([5], timing, frames, 3) for frames in (12, 40))
    assert np.array_equal(short.stamps, long.stamps[:12], equal_nan=True)
