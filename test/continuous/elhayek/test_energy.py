"""Energy of a segment: limits as integrals, gradients, the minimum."""

import hinged_people
import numpy as np
import pytest
from hinged_people import freedoms

from panoptic_ros.continuous.elhayek.energy import SegmentEnergy, limit_sums, minimise
from panoptic_ros.continuous.elhayek.keypoints import Keypoints, KeypointTerm
from panoptic_ros.continuous.elhayek.polynomials import basis

SEGMENT = np.array([0.2, 0.5])
SKELETON = hinged_people.SKELETONS[0]
RIG = hinged_people.HingedCapture(seconds=0.0).rig


def keypoints(count=11, noise=0.0):
    """2D joints of one view each at `count` instants."""
    times = np.linspace(*SEGMENT, count)
    rng, columns = np.random.default_rng(1), []
    for k, joints in enumerate(SKELETON.joints(freedoms(times))):
        camera = RIG.cameras[k % len(RIG)]
        rotation, translation = camera.cam_from_world.rotation, camera.cam_from_world.translation
        local = joints @ rotation.T + translation
        for j, point in enumerate(local[:, :2] / local[:, 2:] + noise * rng.standard_normal((19, 2))):
            row = point[:, None] * rotation[2] - rotation[:2]
            right = translation[:2] - point * translation[2]
            columns.append((times[k], j, row, right, rotation[2], translation[2], 1e-3))
    return Keypoints(*(np.array(column) for column in zip(*columns)))


def fitted(count=6):
    """Coefficients (D, count) of the true motion."""
    times = np.linspace(*SEGMENT, 200)
    return np.linalg.lstsq(basis(times, SEGMENT, count), freedoms(times), rcond=None)[0].T


def test_limits_are_the_squared_area_beyond_them():
    limits = np.array([[-np.inf, np.inf], [-1.0, 1.0], [-1.0, 0.5]])
    coefficients = np.array([[9.0, 9.0], [0.0, 2.0], [0.0, 0.5]])  # the second one crosses both limits
    found = limit_sums(coefficients, limits)
    assert found.energy == pytest.approx((2 * 0.25) ** 2, rel=0.05)  # two triangles: width 1/2, height 1
    assert limit_sums(np.array([[0.0], [3.0], [0.0]]), limits).energy == pytest.approx(16.0)


def test_gradients_are_those_of_differences():
    rng = np.random.default_rng(2)
    start = fitted()
    at = start + 0.05 * rng.standard_normal(start.shape)
    at[15, 0] = 2.5  # an elbow beyond its limit
    energy = SegmentEnergy(SEGMENT, KeypointTerm(keypoints(), SKELETON, 15.0), SKELETON.limits, start)
    sums, step = energy.sums(at), 1e-6
    for d, k in [(0, 0), (3, 1), (7, 2), (12, 0), (15, 0), (15, 3), (20, 4), (27, 5)]:
        way = np.zeros_like(at)
        way[d, k] = step
        slope = (energy.sums(at + way).energy - energy.sums(at - way).energy) / (2.0 * step)
        assert sums.gradient[d, k] == pytest.approx(slope, rel=1e-4, abs=1e-8)
    size = at.size
    assert np.linalg.eigvalsh(sums.matrix.reshape(size, size)).min() > 0.0


def test_the_minimum_is_the_true_motion_and_its_covariance_that_of_the_errors():
    true, count = fitted(), 40
    start = true.copy()
    start[3:, 0] += 0.1
    squares = []
    for noise in (0.0, 1e-3):
        energy = SegmentEnergy(
            SEGMENT, KeypointTerm(keypoints(count, noise), SKELETON, 3.0), SKELETON.limits, true
        )
        wide = KeypointTerm(keypoints(count, noise), SKELETON, 60.0)
        found = minimise(SegmentEnergy(SEGMENT, wide, SKELETON.limits, start), start, 6)
        found = minimise(energy, found, 6)
        gaps = SKELETON.joints(freedoms([0.35])) - SKELETON.joints(
            basis(np.array([0.35]), SEGMENT, 6) @ found.T
        )
        assert np.abs(gaps).max() < (1e-3 if noise == 0.0 else 0.015)
        values = basis(np.array([0.35]), SEGMENT, 6)[0]
        covariance = np.einsum("l,dlem,m->de", values, energy.covariance(found), values)
        squares.append(((found - true) @ values)[:3] ** 2 / np.diag(covariance)[:3])
    assert (squares[1] < 12.0).all() and squares[1].mean() > 0.01
