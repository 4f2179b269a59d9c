"""Motion while the views arrive."""

import captures
import numpy as np
import pytest
from free_cameras import FreeCapture

from panoptic_ros.continuous.bones import rigid_pairs
from panoptic_ros.continuous.online import OnlineMotion
from panoptic_ros.domain.rig_arrays import RigArrays
from panoptic_ros.solving.frames import camera_frames

CAPTURE = FreeCapture(seconds=2.5)
ARRAYS = RigArrays.of(CAPTURE.rig)
FRAMES = camera_frames(CAPTURE.sets, ARRAYS, captures.SKELETON)
STAMPS = np.array([1e-9 * (frame.stamp_ns - 1_000_000_000_000) for frame in FRAMES])


def play(lag):
    motion = OnlineMotion(ARRAYS, np.array(captures.SKELETON.mirror), rigid_pairs(captures.SKELETON), 0.08)
    instants, found, k = np.arange(0.5, 2.3, 0.05), [], 0
    for frame, time in zip(FRAMES, STAMPS):
        while k < len(instants) and instants[k] + lag < time:
            found.append((instants[k], motion.at(instants[k])))
            k += 1
        motion.take(frame, time)
    return motion, found


@pytest.mark.parametrize(("lag", "limit"), [(0.0, 0.02), (0.1, 0.006)])
def test_each_instant_comes_from_the_views_up_to_the_lag(lag, limit):
    _, found = play(lag)
    gaps = []
    for time, people in found:
        truth = CAPTURE.joints(time)
        assert sorted(person.id for person in people) == [0, 1]
        for person in people:
            gaps.append(np.linalg.norm(truth - person.positions, axis=-1).mean(axis=1).min())
    assert np.mean(gaps) < limit


def test_memory_is_bounded():
    motion, _ = play(0.1)
    assert len(motion.frames) <= 1.7 * 60 and all(len(p.track.entries) <= 1.7 * 60 for p in motion.people)
