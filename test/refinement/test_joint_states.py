"""What is measured, and what of the rest is told."""

import numpy as np
import pytest

from panoptic_ros.domain import JointState
from panoptic_ros.refinement.joint_states import SmoothedJoints, judge, take_measurements
from panoptic_ros.refinement.records import MotionStates, unknown

LIMITS = (0.2, 0.1)  # m and s


def test_measurements_replace_those_before():
    measured = unknown(0, 0.0, 3, 2).measured
    measured.scores[...], measured.ages[...] = 0.3, 1.0
    points = np.array([[[1.0, 2.0, 3.0], [np.nan] * 3]])
    covariances = np.tile(np.eye(3), (1, 2, 1, 1))
    scores, views = np.array([[0.9, 0.0]]), np.array([[3, 0]], np.int32)
    take_measurements(measured, np.array([1]), points, covariances, scores, views)
    assert measured.people.tolist() == [False, True, False]
    assert measured.joints.tolist() == [[False, False], [True, False], [False, False]]
    assert measured.scores[1].tolist() == [0.9, 0.3] and measured.ages[1].tolist() == [0.0, 1.0]
    assert np.allclose(measured.noises[1, 0], np.eye(3)) and not measured.noises[1, 1].any()
    assert measured.views[1].tolist() == [3, 0]


@pytest.mark.parametrize(
    ("change", "state"),
    [
        ({}, JointState.FILLED),
        ({"joints": True}, JointState.MEASURED),
        ({"joints": True, "sigma": 0.3}, JointState.MEASURED),
        ({"sigma": 0.21}, JointState.MISSING),
        ({"noise": 0.21}, JointState.MISSING),
        ({"again": False}, JointState.PREDICTED),
        ({"again": False, "people": False}, JointState.MISSING),
        ({"again": False, "ages": 0.11}, JointState.MISSING),
        ({"known": False}, JointState.MISSING),
    ],
)
def test_gaps_that_are_long_or_uncertain_are_missing(change, state):
    """A joint that is not measured, of somebody who is; it was 0.05 s before, and is again."""
    case = {"sigma": 0.19, "noise": 0.0, "again": True, "people": True, "ages": 0.05, "known": True}
    case |= {"joints": False, **change}
    measured = unknown(0, 0.0, 1, 1).measured
    measured.people[0], measured.joints[0], measured.ages[0] = case["people"], case["joints"], case["ages"]
    measured.scores[0], measured.noises[0, 0] = 0.8, case["noise"] ** 2 * np.eye(3)
    motion = MotionStates(np.ones((1, 1, 6)), 0.25 * case["sigma"] ** 2 * np.eye(6)[None, None])
    motion.states[...] = 1.0 if case["known"] else np.nan
    judged = SmoothedJoints(
        np.empty((1, 1, 3)), np.empty((1, 1, 3, 3)), np.empty((1, 1)), np.empty((1, 1), np.uint8)
    )
    judge(motion, measured, np.array([[case["again"]]]), np.array([4.0]), np.ones((1, 1)), LIMITS, judged)
    assert judged.states[0, 0] == state
    if state == JointState.MISSING:
        assert np.isnan(judged.positions).all() and np.isnan(judged.covariances).all() and not judged.scores
    else:
        assert np.allclose(judged.positions, 1.0)
        assert np.allclose(judged.covariances[0, 0], case["sigma"] ** 2 * np.eye(3))
        assert judged.scores == (0.8 if state == JointState.MEASURED else 0.4)
