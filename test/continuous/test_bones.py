"""Lengths as measurements: the exact solution, its approximation, and which pairs are rigid."""

import captures
import numpy as np
import pytest
from free_cameras import FreeCapture

from panoptic_ros.continuous.bones import (
    CORRELATION_S,
    INTERVAL_S,
    SHORTEST,
    PairDistances,
    block_inverses,
    instants,
    learn_lengths,
    length_weights,
    pair_distances,
    rigid_pairs,
    step_with_lengths,
)
from panoptic_ros.continuous.curves import WIDTH, covariances_at, normal_equations
from panoptic_ros.continuous.follow import follow
from panoptic_ros.continuous.problem import CurveProblem, TrackRays, grid_over
from panoptic_ros.continuous.relaxation import relax
from panoptic_ros.domain.rig_arrays import RigArrays
from panoptic_ros.geometry.splines import SPAN, spline
from panoptic_ros.solving.frames import camera_frames

PAIRS = rigid_pairs(captures.SKELETON)
MIRROR = np.array(captures.SKELETON.mirror)


@pytest.fixture(scope="module")
def problem():
    capture = FreeCapture(seconds=1.6, noise_px=1.5)
    arrays = RigArrays.of(capture.rig)
    frames = camera_frames(capture.sets, arrays, captures.SKELETON)
    stamps = np.array([1e-9 * (frame.stamp_ns - frames[0].stamp_ns) for frame in frames])
    track = follow(frames, stamps, arrays, MIRROR)[0]
    rays = TrackRays.of(track.entries, frames, stamps, arrays, MIRROR)
    found = CurveProblem(rays, rays.stamps, arrays, grid_over(rays.stamps))
    found.solve()
    return found


def test_pairs_are_bones_and_those_within_head_and_torso():
    names = captures.SKELETON.joint_names
    pairs = {frozenset((names[a], names[b])) for a, b in PAIRS}
    assert {"lKnee", "lAnkle"} in pairs and {"lShoulder", "rHip"} in pairs and {"lEar", "rEye"} in pairs
    assert frozenset(("lShoulder", "lWrist")) not in pairs and len(pairs) == len(PAIRS)


def test_lengths_of_a_rigid_body_are_learnt(problem):
    learnt = learn_lengths(pair_distances(problem, problem.fit(), PAIRS))
    body = captures.person((0.0, 0.0), 0.0)
    truth = np.linalg.norm(body[PAIRS[:, 0]] - body[PAIRS[:, 1]], axis=1)
    assert np.abs(learnt.lengths - truth).max() < 0.008 and (learnt.weights > 0.0).all()


def test_a_pair_that_moves_is_soft_or_free():
    times = np.linspace(0.0, 10.0, 400)
    lengths = np.stack([0.3 + a * np.sin(times) for a in (0.0, 0.02, 0.2)])
    learnt = learn_lengths(PairDistances(lengths, np.full(lengths.shape, 1e-6)))
    assert learnt.weights[0] > 100.0 * learnt.weights[1] > 0.0 and learnt.weights[2] == 0.0


def test_lengths_bring_the_joints_to_their_distances(problem):
    fit = problem.fit()
    learnt = learn_lengths(pair_distances(problem, fit, PAIRS))

    def spread(points):
        changed = fit._replace(points=points)
        return np.std(pair_distances(problem, changed, PAIRS).lengths, axis=1).mean()

    exact, _ = step(problem, fit.points, learnt)
    assert spread(exact) < 0.6 * spread(fit.points)
    change = relax(fit.factors, fit.points, problem.grid, instants(problem), PAIRS, learnt, 60)
    np.testing.assert_allclose(fit.points + change, exact, atol=5e-5)  # the step has a bound of its matrix
    few = relax(fit.factors, fit.points, problem.grid, instants(problem), PAIRS, learnt, 10)
    assert np.abs(fit.points + few - exact).mean() < 1e-4


def step(problem, points, learnt):
    """Control points after one step, and the factor."""
    count, size = problem.grid.number, 3 * len(points)
    factor = np.empty((count, SPAN, size, size))
    weights = np.repeat(learnt.weights[:, None], len(instants(problem)), axis=1)
    return step_with_lengths(problem, points, PAIRS, learnt, weights, problem.stiffness, factor), factor


def dense_step(problem, points, learnt):
    """Change of the control points (K, J, 3) and its covariance (K, J, 3, K, J, 3), by dense matrices."""
    joints, count, _ = points.shape
    bands, rights = normal_equations(problem.rays, problem.grid, problem.stiffness)
    matrix, right = np.zeros((count, joints, 3, count, joints, 3)), np.empty((count, joints, 3))
    for j in range(joints):
        own = np.zeros((3 * count, 3 * count))
        for k in range(WIDTH):
            own[np.arange(k, 3 * count), np.arange(3 * count - k)] = bands[j, k:, k]
        own += np.tril(own, -1).T
        matrix[:, j, :, :, j] = own.reshape(count, 3, count, 3)
        right[:, j] = (rights[j] - own @ points[j].ravel()).reshape(count, 3)
    times = instants(problem)
    basis = spline(problem.grid.origin, problem.grid.step, np.eye(count))(times)
    for (a, b), length, weight in zip(PAIRS, learnt.lengths, learnt.weights):
        gaps = basis @ (points[a] - points[b])
        lengths = np.maximum(np.linalg.norm(gaps, axis=1), SHORTEST)
        rows = np.zeros((len(times), count, joints, 3))
        rows[:, :, a] = basis[:, :, None] * (gaps / lengths[:, None])[:, None]
        rows[:, :, b] = -rows[:, :, a]
        right += weight * np.einsum("tkja,t->kja", rows, length - lengths)
        matrix += weight * np.einsum("tkja,tlib->kjalib", rows, rows)
    size = 3 * joints * count
    covariance = np.linalg.inv(matrix.reshape(size, size))
    return (covariance @ right.ravel()).reshape(right.shape), covariance.reshape(matrix.shape)


@pytest.mark.parametrize(("persistent", "near"), [(0.0, 1e-6), (0.4, 0.02)])
def test_a_step_and_its_covariances_are_those_of_the_dense_system(problem, persistent, near):
    fit = problem.fit()
    learnt = learn_lengths(pair_distances(problem, fit, PAIRS))
    problem.persistent = persistent
    expected, covariance = dense_step(problem, fit.points, learnt)
    points, factor = step(problem, fit.points, learnt)
    change = (points - fit.points).transpose(1, 0, 2)
    assert np.abs(change - expected).max() < near * np.abs(expected).max()
    inverses = block_inverses(factor)
    for j in range(len(points)):
        own = covariance[:, j, :, :, j].reshape(3 * problem.grid.number, -1)
        np.testing.assert_allclose(inverses[j, :, 0], np.diag(own), rtol=near)
        lag = (
            7  # between the first axis of a control point, and the second one of a control point 3 knots away
        )
        near_zero = near * np.abs(np.diag(own)).max()
        np.testing.assert_allclose(inverses[j, lag:, lag], np.diag(own, -lag), atol=near_zero)
    problem.persistent = 0.0


def test_steps_reach_the_same_curves_as_dense_steps_if_noise_persists(problem):
    fit = problem.fit()
    learnt = learn_lengths(pair_distances(problem, fit, PAIRS))
    problem.persistent = 0.4
    points = fit.points
    for _ in range(20):
        points, _ = step(problem, points, learnt)
    assert np.abs(dense_step(problem, points, learnt)[0]).max() < 1e-9
    problem.persistent = 0.0


def test_lengths_of_hidden_joints_weigh_less(problem):
    """Compare the added variance with a Monte Carlo sample of the second-order term."""
    fit = problem.fit()
    learnt = learn_lengths(pair_distances(problem, fit, PAIRS))
    whole = length_weights(problem, fit, PAIRS, learnt)
    times, knee = instants(problem), captures.SKELETON.joint_names.index("lKnee")
    row = int(np.flatnonzero((PAIRS == knee).any(axis=1))[0])
    middle = len(times) // 2
    assert np.array_equal(whole[:, middle], learnt.weights)
    inside, inverses = problem.inside.copy(), fit.inverses.copy()
    problem.inside[knee] = False
    inverses[knee] = 0.0
    inverses[knee, :, 0] = 0.01  # m^2
    changed = length_weights(problem, fit._replace(inverses=inverses), PAIRS, learnt)
    problem.inside[:] = inside
    covariance = covariances_at(inverses, problem.grid, times[[middle]])[:, 0]
    places = spline(problem.grid.origin, problem.grid.step, fit.points.transpose(1, 0, 2))(times[[middle]])[0]
    a, b = PAIRS[row]
    gap, spread = places[a] - places[b], covariance[a] + covariance[b]
    across = np.eye(3) - np.outer(gap, gap) / (gap @ gap)
    sample = np.random.default_rng(0).multivariate_normal(np.zeros(3), spread, 100_000)
    bends = 0.5 * np.einsum("ni,ij,nj->n", sample, across, sample) / learnt.lengths[row]
    share = 2.0 * CORRELATION_S / INTERVAL_S
    expected = 1.0 / (1.0 / learnt.weights[row] + share * bends.var())
    assert (
        changed[row, middle] == pytest.approx(expected, rel=0.03)
        and changed[row, middle] < whole[row, middle]
    )
    others = ~(PAIRS == knee).any(axis=1)
    np.testing.assert_array_equal(changed[others], whole[others])
