"""Skeletons that are mended by bodies whose truth is known."""

from dataclasses import replace

import numpy as np
import pytest

from panoptic_ros.domain import JointState
from panoptic_ros.domain.bodies import BodyStateSet
from panoptic_ros.geometry.rotations import to_quaternions, turn_about_z
from panoptic_ros.refinement.joint_states import SmoothedJoints
from panoptic_ros.refinement.stage import BodyFill

PERIOD = 20_000_000
OFFSETS = np.array([[0.02, 0.0, 0.01], [0.0, 0.03, 0.0], [-0.01, 0.01, 0.0]])  # of the detector, in the hips


def hips_at(stamp_ns):
    return turn_about_z(1e-9 * stamp_ns)


def joints_at(stamp_ns):
    """Of somebody who walks along x at 1 m/s and turns, (3, 3) m."""
    limbs = np.array([[0.0, 0.0, 1.0], [0.3, 0.0, 1.0], [0.3, 0.0, 0.7]])
    return np.array([1e-9 * stamp_ns, 0.0, 0.0]) + limbs @ hips_at(stamp_ns).T


def seen_at(stamp_ns):
    """The same as the detector has them."""
    return joints_at(stamp_ns) + OFFSETS @ hips_at(stamp_ns).T


def bodies(stamp_ns, devices, error=0.0):
    one = np.zeros((1, 1, 3))
    return BodyStateSet(
        0,
        stamp_ns,
        stamp_ns,
        "hash",
        ("hips",),
        [-1],
        [7],
        [2],
        [2],
        [devices],
        one,
        np.zeros((1, 6)),
        one,
        to_quaternions(hips_at(stamp_ns)[None])[None],
        np.zeros((1, 1, 6)),
        np.zeros((1, 1, 6, 6)),
        joints_at(stamp_ns)[None] + error,
        np.tile(1e-4 * np.eye(3), (1, 3, 1, 1)),
    )


NO_BIASES = np.zeros((3, 3, 3))


def judged(stamp_ns, error, states, sigma=0.03):
    there = np.array(states)[:, None] != JointState.MISSING
    return SmoothedJoints(
        np.where(there, seen_at(stamp_ns) + error, np.nan)[None],
        np.where(there[..., None], sigma**2 * np.eye(3), np.nan)[None],
        0.8 * there[None, :, 0],
        np.array([states], np.uint8),
    )


def taught(devices, looks=40):
    """What has learnt from well seen joints, and the stamp of the next instant."""
    fill = BodyFill()
    for k in range(looks):
        fill.take(bodies(k * PERIOD, devices), NO_BIASES, None)
        well = judged(k * PERIOD, 0.0, [JointState.MEASURED] * 3)
        before = well.positions.copy()
        fill.fill(k * PERIOD, np.array([7]), well, np.full((1, 3), 3), noises(), 0.2)
        np.testing.assert_array_equal(well.positions, before)
    return fill, looks * PERIOD


def noises(sigma=0.05):
    return np.tile(sigma**2 * np.eye(3), (1, 3, 1, 1))


@pytest.mark.parametrize("ahead_ns", [0, 8_000_000])
def test_joints_that_few_views_see_are_where_the_detector_would_have_them(ahead_ns):
    fill, stamp = taught(devices=6)
    fill.take(bodies(stamp, 6), NO_BIASES, None)
    stamp += ahead_ns  # the body is carried on
    states = [JointState.MEASURED, JointState.MEASURED, JointState.MISSING]
    poor = judged(stamp, np.array([0.0, 0.1, 0.0]), states)
    fill.fill(stamp, np.array([7]), poor, np.array([[3, 2, 0]]), noises(), 0.2)
    errors = np.linalg.norm(poor.positions[0] - seen_at(stamp), axis=-1)
    assert errors[0] == pytest.approx(0.1)  # well seen
    assert errors[1] < 0.02
    assert errors[2] < 0.005 and poor.states[0, 2] == JointState.FILLED and poor.scores[0, 2] > 0.0
    assert (np.linalg.eigvalsh(poor.covariances[0]) > 0.0).all()


@pytest.mark.parametrize(("sigma", "least", "most"), [(0.01, 0.2, 0.95), (0.3, 0.0, 0.05)])
def test_covariances_decide_between_the_body_and_joints_that_two_views_or_one_see(sigma, least, most):
    fill, stamp = taught(devices=0)
    fill.take(bodies(stamp, 0), NO_BIASES, None)
    poor = judged(stamp, 0.05, [JointState.MEASURED] * 3, sigma=sigma)
    fill.fill(stamp, np.array([7]), poor, np.array([[3, 2, 1]]), noises(), 0.2)
    left = np.linalg.norm(poor.positions[0] - seen_at(stamp), axis=-1) / np.linalg.norm(np.full(3, 0.05))
    assert left[0] == pytest.approx(1.0)
    assert (least < left[1:]).all() and (left[1:] < most).all()


def test_a_body_and_a_skeleton_that_are_far_apart_are_both_less_certain():
    fill, stamp = taught(devices=0)
    fill.take(bodies(stamp, 0), NO_BIASES, None)
    shares, spreads = [], []
    for error in (0.01, 0.5):
        poor = judged(stamp, error, [JointState.MEASURED] * 3, sigma=0.02)
        fill.fill(stamp, np.array([7]), poor, np.array([[3, 1, 1]]), noises(), 0.2)
        shares.append((poor.positions[0] - seen_at(stamp))[1:] / error)
        spreads.append(np.trace(poor.covariances[0, 1]))
    np.testing.assert_allclose(shares[1], shares[0])
    assert spreads[1] > 10.0 * spreads[0]


def test_biases_that_a_body_shares_with_a_skeleton_do_not_count_against_it():
    biases, moved = np.tile(0.04**2 * np.eye(3), (3, 1, 1)), []
    for own in (NO_BIASES, biases):
        fill, told = BodyFill(), bodies(0, 0)
        fill.take(replace(told, keypoint_covariances=told.keypoint_covariances + own), own, None)
        poor = judged(0, 0.05, [JointState.MEASURED] * 3)
        fill.fill(0, np.array([7]), poor, np.full((1, 3), 2), noises(), 0.2)
        moved.append(poor)
    np.testing.assert_allclose(moved[1].positions, moved[0].positions)
    np.testing.assert_allclose(moved[1].covariances, moved[0].covariances)


def test_a_body_that_is_off_well_seen_joints_counts_little():
    good, stamp = taught(devices=6)
    bad, rng = BodyFill(), np.random.default_rng(0)
    for k in range(40):
        bad.take(bodies(k * PERIOD, 6, rng.normal(0.0, 0.3, (3, 3))), NO_BIASES, None)
        well = judged(k * PERIOD, 0.0, [JointState.MEASURED] * 3)
        bad.fill(k * PERIOD, np.array([7]), well, np.full((1, 3), 4), noises(), 0.2)
    moved = []
    for fill in (good, bad):
        fill.take(bodies(stamp, 6), NO_BIASES, None)
        poor = judged(stamp, 0.05, [JointState.MEASURED] * 3)
        fill.fill(stamp, np.array([7]), poor, np.full((1, 3), 2), noises(), 0.2)
        moved.append(np.linalg.norm(poor.positions[0] - seen_at(stamp) - 0.05, axis=-1).mean())
    assert moved[1] < 0.2 * moved[0]


def test_nothing_is_said_of_people_without_a_body_or_with_an_old_one():
    fill, stamp = taught(devices=6)
    for number, later in ((8, stamp), (7, stamp + 300_000_000)):
        poor = judged(later, 0.05, [JointState.MEASURED] * 3)
        before = poor.positions.copy()
        fill.fill(later, np.array([number]), poor, np.full((1, 3), 1), noises(), 0.2)
        np.testing.assert_array_equal(poor.positions, before)
