"""Slow cameras that expose at different times are told from those that need no other command."""

from dataclasses import replace

import captures
import numpy as np
import pytest

from panoptic_ros.domain import DetectionSet
from panoptic_ros.evaluation.free_running import free_running

MS = 1_000_000


def sets(rate, shifts_ms, jitter_ms=0.0, frames=30):
    """Sets of the four cameras, whose timestamps are shifted, with normal jitter."""
    rng = np.random.default_rng(4)
    found = []
    for k in range(frames):
        views = []
        for camera, shift in zip(captures.RIG.cameras, shifts_ms):
            late = round(MS * (100.0 + shift + jitter_ms * rng.standard_normal()))
            view = captures.view(camera, k, round(k * 1e9 / rate))
            views.append(replace(view, stamp_ns=view.stamp_ns + late))
        middle = views[0].stamp_ns
        found.append(DetectionSet(k, middle, captures.SKELETON.hash, tuple(views)))
    return found


@pytest.mark.parametrize(
    ("rate", "shifts_ms", "jitter_ms"),
    [
        (6.4, (0, 40, 80, 120), 0.0),
        (12.5, (0, 20, 40, 60), 1.0),
        (15.0, (0, 33, 0, 33), 0.0),
        (20, (0, 12, 24, 36), 0),
    ],
)
def test_slow_cameras_in_turn(rate, shifts_ms, jitter_ms):
    found = free_running(sets(rate, shifts_ms, jitter_ms))
    assert found.period == pytest.approx(1.0 / rate, rel=0.05)
    assert found.apart == pytest.approx(1e-3 * np.ptp(shifts_ms), rel=0.2)
    assert f"{rate:.1f} Hz" in str(found)


@pytest.mark.parametrize(
    ("rate", "shifts_ms", "jitter_ms"),
    [
        (6.4, (0, 0, 0, 0), 0.0),
        (10.0, (0, 0, 0, 0), 2.0),  # software timestamps of one trigger
        (10.0, (0, 0, 500, 0), 1.0),  # one clock is wrong
        (25.0, (0, 10, 20, 30), 0.0),
        (30.0, (0, 8, 16, 24), 1.0),
    ],
)
def test_synchronous_or_fast_cameras(rate, shifts_ms, jitter_ms):
    assert free_running(sets(rate, shifts_ms, jitter_ms)) is None


def test_too_little_to_tell():
    assert free_running([]) is None
    assert free_running(sets(6.4, (0, 40, 80, 120), frames=5)) is None
