"""The filter in time, on a body whose motion is known exactly."""

import numpy as np
import pytest
from bodies import CHAIN, MODEL, D, S, no_prior, placed

from panoptic_ros.geometry.chain import Pose
from panoptic_ros.geometry.rotations import rotations_of
from panoptic_ros.kinematics.pose.normal_equations import assemble
from panoptic_ros.kinematics.pose.targets import (
    NO_FLOOR,
    NO_TURNS,
    NO_VIEWS,
    Accelerations,
    IncrementEvidence,
    PointTargets,
    PoseEvidence,
    no_anchor,
)
from panoptic_ros.kinematics.pose.window import AccelerationModel, PoseWindow

PERIOD = 1.0 / 60.0
EVEN, UNEVEN = (1,) * 9, (1, 1, 2, 1, 3, 1, 1, 2, 1)  # periods between instants
WORN = np.array([MODEL.index(n) for n in ("hips", "spine4", "lForearm", "rShin")])
MOTION = AccelerationModel(8.0, 60.0, PERIOD)
OFFSETS = np.array([[0.1, 0, 0], [0.1, 0, 0.05], [0, 0.15, 0.03], [0.05, 0, -0.2]])


def moving(count, seed=0):
    rng = np.random.default_rng(seed)
    t = PERIOD * np.arange(count)
    phase, speed = rng.uniform(0, 6.3, (2, D)), rng.uniform(2, 6, D)
    wave = 0.25 * np.sin(speed[None] * t[:, None] + phase[0])
    return [Pose(np.array([0, 0, 1.0]) + row[:3], rotations_of(row[3:].reshape(S, 3).copy())) for row in wave]


def points(pose, noise, rng, weight):
    frames, places = placed(pose)
    segments = np.repeat(np.arange(S), 3)
    offsets = np.tile(0.1 * np.eye(3), (S, 1))
    goals = places[segments] + (frames[segments] @ offsets[..., None])[..., 0]
    information = np.tile(np.eye(3) / 0.02**2, (len(segments), 1, 1))
    goals = goals + noise * rng.normal(size=goals.shape)
    targets = PointTargets(segments, offsets, goals, information, 0.0)
    return PoseEvidence(NO_VIEWS, targets, NO_TURNS, NO_FLOOR, no_prior(S), weight)


def sites(pose):
    frames, places = placed(pose)
    return places[WORN] + (frames[WORN] @ OFFSETS[..., None])[..., 0]


def run(poses, lag, noise=0.02, weight=0.05, accelerations=True, sd=1.0, error=0.0):
    rng = np.random.default_rng(1)
    window = PoseWindow(CHAIN, poses[0], AccelerationModel(8.0, 60.0, PERIOD), lag)
    found = []
    for t in range(1, len(poses)):
        given = {}
        if accelerations and t >= 2:
            values = (sites(poses[t]) - 2 * sites(poses[t - 1]) + sites(poses[t - 2])) / PERIOD**2
            values = values + error * rng.normal(size=values.shape)
            given = {
                "between": IncrementEvidence(Accelerations(WORN, OFFSETS, values, np.full(4, sd**-2), 9.0))
            }
        window.step(window.predicted(), points(poses[t], noise, rng, weight), **given)
        if t >= lag:
            found.append((t - lag, window.smoothed()[lag]))
    return found


def error_mm(poses, found, skip=60):
    apart = [np.linalg.norm(placed(p)[1] - placed(poses[t])[1], axis=-1) for t, p in found if t >= skip]
    return 1000 * float(np.mean(apart))


def test_exact_data_are_followed():
    poses = moving(120)
    assert error_mm(poses, run(poses, 0, noise=0.0, weight=1.0)) < 3.0
    assert error_mm(poses, run(poses, 6, noise=0.0, weight=1.0)) < 1.0


@pytest.mark.parametrize("lag", [0, 6])
def test_accelerations_help(lag):
    poses = moving(180)
    without = error_mm(poses, run(poses, lag, accelerations=False))
    assert error_mm(poses, run(poses, lag, error=0.3)) < 0.95 * without


@pytest.mark.parametrize("accelerations", [False, True])
def test_where_instants_are_left_out_a_steady_body_is_followed_all_the_same(accelerations):
    start, end = np.array([0.0, 0.0, 1.0]), np.array([2.0, 0.5, 1.0])
    still = moving(1)[0]
    window, rng, time, last = PoseWindow(CHAIN, still._replace(root=start), MOTION, 6), None, 0, start
    given = Accelerations(WORN, OFFSETS, np.zeros((4, 3)), np.full(4, 1.0), 9.0)
    for stride in (*EVEN * 4, *UNEVEN, 6, 1, 4, 4):
        time += stride
        pose = still._replace(root=start + time / 80.0 * (end - start))
        guess = window.predicted(stride)
        between = (
            IncrementEvidence(given, stride=stride) if accelerations else IncrementEvidence(stride=stride)
        )
        last = window.step(guess, points(pose, 0.0, rng or np.random.default_rng(0), 1.0), between)
        if time > 36:
            assert np.abs(guess.root - pose.root).max() < 2e-3 and np.abs(last.root - pose.root).max() < 1e-3
    before = window.smoothed()[3]  # three instants ago, nine periods
    assert np.abs(before.root - (start + (time - 9) / 80.0 * (end - start))).max() < 1e-3


def test_a_body_that_stops_at_once_while_nobody_sees_it_is_known_to_stop():
    """All devices feel it alike, so it is not an outlier."""
    still, rng = moving(1)[0], np.random.default_rng(0)
    along = 3.0 * PERIOD * np.minimum(np.arange(61), 30)
    poses = [still._replace(root=still.root + [x, 0.0, 0.0]) for x in along]
    window = PoseWindow(CHAIN, poses[0], MOTION, 0)
    for t in range(1, len(poses)):
        bend = along[t] - 2.0 * along[t - 1] + along[t - 2] if t >= 2 else 0.0
        values = np.tile([bend / PERIOD**2, 0.0, 0.0], (4, 1))
        given = Accelerations(WORN, OFFSETS, values, np.full(4, 0.25), 9.0)
        evidence = points(poses[t], 0.0, rng, 1.0 if t <= 30 else 1e-9)
        last = window.step(window.predicted(), evidence, IncrementEvidence(given))
    assert abs(last.root[0] - poses[-1].root[0]) < 0.1


def test_a_lag_helps():
    poses = moving(180)
    assert error_mm(poses, run(poses, 6)) < 0.8 * error_mm(poses, run(poses, 0))


@pytest.mark.parametrize("lasting", [0.0, 0.7])
@pytest.mark.parametrize(("back", "strides"), [(0, EVEN), (1, EVEN), (4, EVEN), (1, UNEVEN), (4, UNEVEN)])
def test_the_covariance_of_a_pose_is_that_of_all_data_so_far(back, strides, lasting):
    """Against the dense matrix of all poses of a body that stands still; some instants were left out."""
    pose, count, motion, weight = moving(1)[0], 9, AccelerationModel(8.0, 60.0, PERIOD), 0.1
    window = PoseWindow(CHAIN, pose, motion, 5)
    evidence = points(pose, 0.0, np.random.default_rng(0), weight)
    for stride in strides:
        window.step(pose.copy(), evidence, IncrementEvidence(stride=stride))
    own, gradient = np.empty((D, D)), np.empty(D)
    assemble(CHAIN, pose, evidence, no_anchor(S), own, gradient)
    dense = np.zeros((count + 2, D, count + 2, D))
    dense[:2, :, :2] = PoseWindow(CHAIN, pose, motion, 5).start.reshape(2, D, 2, D)
    bend = np.diag(motion.weights(D))
    for t in range(2, count + 2):
        dense[t, :, t] += own
        before, later = (1, *strides)[t - 2 : t]
        ratio, steps = later / before, 0.5 * later * (before + later)
        factors = (ratio, -1.0 - ratio, 1.0)
        for a, left in enumerate(factors):
            for b, right in enumerate(factors):
                dense[t - 2 + a, :, t - 2 + b] += left * right * bend / steps**2
    covariance = np.linalg.inv(dense.reshape((count + 2) * D, -1)).reshape(dense.shape)
    last = count + 1 - back
    # errors of one instant move the pose by these steps; those that last are the same in all of them
    steps = covariance[last, :, 2:] @ np.linalg.cholesky(own)
    common = steps.sum(1) - steps[:, last - 2] / (2.0 * weight)
    expected = covariance[last, :, last] + lasting * weight * common @ common.T
    found = window.covariance(back, lasting)
    assert np.allclose(found, expected, rtol=1e-3, atol=2e-3 * expected.max())


def test_errors_that_last_leave_a_pose_as_unsure_as_few_looks_at_it():
    """However long a body stands still before the same cameras, with motion that would be noticed."""
    pose, weight = moving(1)[0], 0.1
    window = PoseWindow(CHAIN, pose, AccelerationModel(0.05, 0.5, PERIOD), 6)
    evidence = points(pose, 0.0, np.random.default_rng(0), weight)
    for _ in range(200):
        window.step(pose.copy(), evidence)
    own, gradient = np.empty((D, D)), np.empty(D)
    assemble(CHAIN, pose, evidence._replace(weight=1.0), no_anchor(S), own, gradient)
    look = np.diag(np.linalg.inv(own))
    assert np.all(np.diag(window.covariance(6, 0.0)) < 0.4 * look)
    assert np.all(np.diag(window.covariance(6, 1.0)) > 0.7 * look)
    assert np.all(np.diag(window.covariance(6, 1.0)) < 1.3 * look)


def test_what_comes_after_a_pose_is_kept_for_some_instants():
    """While nothing changes that makes no difference; what came up to the pose counts at once."""
    pose, rng = moving(1)[0], np.random.default_rng(0)
    window = PoseWindow(CHAIN, pose, AccelerationModel(8.0, 60.0, PERIOD), 6)
    few, many = (points(pose, 0.0, rng, weight) for weight in (0.05, 0.5))
    for _ in range(60):
        window.step(pose.copy(), few)
    for _ in range(5):
        window.step(pose.copy(), few)
        kept, exact = window.covariance(6, 0.5, 2), window.covariance(6, 0.5)
        assert np.allclose(kept, exact, rtol=1e-4, atol=1e-6 * exact.max())
    same = []
    for _ in range(6):
        window.step(pose.copy(), many)
        kept, exact = window.covariance(6, 0.5, 2), window.covariance(6, 0.5)
        same.append(np.array_equal(kept, exact))
    assert same.count(True) == 2  # found anew every third instant
    for _ in range(6):
        window.step(pose.copy(), many)
        kept, exact = window.covariance(6, 0.5, 2), window.covariance(6, 0.5)
    assert np.allclose(np.diag(kept), np.diag(exact), rtol=0.1)


def test_what_came_later_makes_a_pose_surer():
    poses = moving(30)
    rng = np.random.default_rng(1)
    window = PoseWindow(CHAIN, poses[0], AccelerationModel(8.0, 60.0, PERIOD), 6)
    for pose in poses[1:]:
        window.step(window.predicted(), points(pose, 0.02, rng, 0.05))
    newest, past = (window.covariance(back, 0.0) for back in (0, 6))
    assert np.all(np.diag(past) < 0.8 * np.diag(newest))
