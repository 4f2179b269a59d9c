"""Energy, steps and covariances of curves of degrees of freedom, against differences and dense matrices."""

import numpy as np
import pytest
from hinged_people import SKELETONS, HingedCapture, freedoms
from scipy.linalg import block_diag

from panoptic_ros.continuous.config import ContinuousConfig
from panoptic_ros.continuous.passes import ContinuousPass
from panoptic_ros.continuous.problem import CurveProblem
from panoptic_ros.continuous.subjects.curves import FreedomProblem
from panoptic_ros.domain.rig_arrays import RigArrays
from panoptic_ros.geometry.splines import DEGREE
from panoptic_ros.stage import untold

ELBOW = 15  # degree of freedom of the left elbow
WRIST = 5  # left, index of the joint


@pytest.fixture(scope="module")
def capture():
    return HingedCapture(cameras=4, rate=12.5, seconds=0.6, there=lambda person, time: person == 0)


@pytest.fixture(scope="module")
def person(capture):
    return ContinuousPass(ContinuousConfig(), capture.context).run(capture.recording, untold).people[0]


def problem_of(capture, person, start=None, persistent=0.0):
    """Problem about the true poses at the control points, or about others."""
    problem = CurveProblem(person.rays, person.times, RigArrays.of(capture.rig), person.grid)
    problem.persistent = persistent
    if start is None:
        start = true_points(person)
    return FreedomProblem(problem, SKELETONS[0], start)


def true_points(person):
    middles = person.grid.origin + person.grid.step * (np.arange(person.grid.number) - 1.5)
    return freedoms(middles + 0.3)


@pytest.mark.parametrize("persistent", [0.0, 0.3])
def test_a_step_is_the_derivative_of_the_energy(capture, person, persistent):
    start = true_points(person)
    start[:, ELBOW] += 3.0  # beyond its limit, so that the limits count
    one = problem_of(capture, person, start, persistent)
    positions, slopes = one._at_rays(start)
    one._problem.place(positions)
    _, right = one._system(start, one._problem.misses, slopes)
    rng = np.random.default_rng(0)
    for _ in range(3):
        along = 1e-5 * rng.standard_normal(start.shape)

        def energy(points):
            return one._energy(points, one._problem.misses_of(one._at_rays(points)[0]))

        slope = 0.5 * (energy(start + along) - energy(start - along))
        assert slope == pytest.approx(-2.0 * (right * along).sum(), rel=1e-4)


def test_covariances_are_those_of_the_dense_matrix(capture, person):
    one = problem_of(capture, person, persistent=0.3)
    points = true_points(person)
    positions, slopes = one._at_rays(points)
    one._problem.place(positions)
    factor, _ = one._system(points, one._problem.misses, slopes)
    count, freedoms = points.shape
    lower = np.eye(points.size).reshape(count, freedoms, count, freedoms)
    for k in range(count):
        for p in range(1, min(factor.shape[1], count - k)):
            lower[k + p, :, k] = factor[k, p]
    back = np.linalg.inv(lower.reshape(points.size, points.size))
    whole = (back.T @ block_diag(*factor[:, 0]) @ back).reshape(count, freedoms, count, freedoms)
    found = one._covariances(factor)
    weights = np.array([1.0, 11.0, 11.0, 1.0]) / 24.0  # basis of the spline at a knot
    for knot in (0, 3, len(points) - DEGREE):
        own = whole[knot : knot + DEGREE, :, knot : knot + DEGREE]
        assert found[knot] == pytest.approx(np.einsum("p,pdqe,q->de", weights, own, weights), rel=1e-6)


def test_limits_bend_what_no_view_shows(capture, person):
    """Without rays of the hand, the elbow returns to its limit."""
    shown = person.rays.joints != WRIST
    start, limit = true_points(person), SKELETONS[0].limits[ELBOW, 1]
    start[:, ELBOW] = limit + 0.5
    problem = CurveProblem(
        person.rays.subset(shown), person.times[shown], RigArrays.of(capture.rig), person.grid
    )
    problem.solve()
    found = FreedomProblem(problem, SKELETONS[0], start).solve().points
    assert np.abs(found[2:-2, ELBOW] - limit).max() < 0.05
