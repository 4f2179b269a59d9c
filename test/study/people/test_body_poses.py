"""Bodies at the instants of skeletons, one half of the time apart."""

import numpy as np
import pytest

from panoptic_ros.domain import JointState, TrackedPoseSet
from panoptic_ros.domain.bodies import BodyStateSet
from panoptic_ros.study.people.fill import both_at

STEP = 20_000_000


def skeleton(stamp_ns, ids, missing=()):
    states = np.full((len(ids), 2), JointState.MEASURED)
    for row, joint in missing:
        states[row, joint] = JointState.MISSING
    there = states != JointState.MISSING
    positions = np.where(there[..., None], np.zeros((len(ids), 2, 3)), np.nan)
    covariances = np.where(there[..., None, None], np.tile(np.eye(3), (len(ids), 2, 1, 1)), np.nan)
    return TrackedPoseSet(
        stamp_ns // STEP,
        stamp_ns,
        "hash",
        positions,
        covariances,
        0.5 * there,
        3 * there,
        states,
        np.ones(len(ids)),
        ids=np.array(ids),
    )


def body(stamp_ns, number, x):
    one = np.zeros((1, 1, 3))
    points = np.array([[[x, 0.0, 0.0], [x, 1.0, 0.0]]])
    return BodyStateSet(
        0,
        stamp_ns,
        stamp_ns,
        "hash",
        ("hips",),
        [-1],
        [number],
        [2],
        [2],
        [0],
        one,
        np.zeros((1, 6)),
        one,
        [[[1.0, 0.0, 0.0, 0.0]]],
        np.zeros((1, 1, 6)),
        np.zeros((1, 1, 6, 6)),
        points,
        np.tile(np.eye(3), (1, 2, 1, 1)),
    )


def test_bodies_are_taken_between_two_of_their_instants():
    bodies = [body(0, 7, 0.0), body(2 * STEP, 7, 1.0)]
    plain, posed = both_at([skeleton(STEP, [3, 7], missing=[(1, 1)])], bodies)
    assert [p.ids.tolist() for p in (*plain, *posed)] == [[7], [7]]
    assert posed[0].positions[0, 0] == pytest.approx([0.5, 0.0, 0.0])
    assert np.isnan(posed[0].positions[0, 1]).all() and plain[0].positions[0, 0].tolist() == [0.0] * 3


def test_who_has_no_body_about_then_is_left_out():
    plain, posed = both_at([skeleton(0, [7]), skeleton(50 * STEP, [7])], [body(0, 7, 0.0)])
    assert [len(p.ids) for p in plain] == [len(p.ids) for p in posed] == [1, 0]
