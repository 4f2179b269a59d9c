"""Covariance that a calibration adds to joints, against rigs that are drawn from it."""

from dataclasses import replace

import numpy as np
import pytest
from drawn_rigs import drawn, triangulated

from panoptic_ros.domain import Camera, Rig
from panoptic_ros.geometry import Intrinsics
from panoptic_ros.simulation.rigs import looking_at
from panoptic_ros.solving.calibration_errors import CELLS, MIN_DEPTH, CalibrationErrors

BROWN = (-0.12, 0.05, 0.001, -0.0005, 0.01)
FISHEYE = (-0.02, 0.003, 0.001, -0.0005)
POINTS = np.random.default_rng(3).uniform([-1.0, -1.0, 0.0], [1.0, 1.0, 2.0], (20, 3))
RIGS, BOUNDS = 300, (0.9, 1.1)


def uncertain_rig(lens: str, seed: int = 0) -> Rig:
    """Return four cameras with full covariances that mix all terms of a camera."""
    rng, terms = np.random.default_rng(seed), BROWN if lens == "brown" else FISHEYE
    cameras = []
    for k, angle in enumerate((0.0, 1.2, 2.9, 4.4)):
        place = np.array([4.0 * np.cos(angle), 4.0 * np.sin(angle), 2.0 + 0.3 * k])
        matrix = np.array([[900.0, 0.0, 650.0], [0.0, 910.0, 350.0], [0.0, 0.0, 1.0]])
        deviations = np.array([*3 * (6e-4,), *3 * (2e-3,), *4 * (0.8,), *len(terms) * (1e-3,)])
        mixing = np.eye(len(deviations)) + 0.4 * rng.normal(size=(len(deviations),) * 2) / 3.0
        root = deviations[:, None] * mixing
        pose = looking_at(place, np.array([0.0, 0.0, 1.0]))
        intrinsics = Intrinsics(matrix, np.array(terms), lens)  # type: ignore[arg-type] # of two names
        cameras.append(Camera(f"c{k}", (1280, 720), intrinsics, pose, covariance=root @ root.T))
    return Rig(tuple(cameras))


def by_numpy(errors: CalibrationErrors, points: np.ndarray, used: np.ndarray) -> np.ndarray:
    """Return the covariances (N, 3, 3) m^2, view by view, with dense matrices."""
    found = np.zeros((len(points), 3, 3))
    for n in np.flatnonzero(np.isfinite(points).all(axis=1)):
        views = []
        for c, (turn, move) in enumerate(zip(errors.rotations, errors.translations)):
            local = turn @ points[n] + move
            plane = local[:2] / local[2]
            place = (plane - errors.corners[c]) / errors.sizes[c]
            if local[2] > MIN_DEPTH and (place >= 0.0).all() and (place <= CELLS).all():
                column, row = np.minimum(place.astype(int), CELLS - 1)
                terms = errors.tables[c, column, row].reshape(3, 2, 2)
                error = terms[0] + terms[1] / local[2] + terms[2] / local[2] ** 2
                slope = (turn[:2] - plane[:, None] * turn[2]) / local[2]
                views.append((c, error, slope))
        own = [view for view in views if used[n, view[0]]]
        views = own if len(own) >= 2 else views
        if len(views) >= 2:
            weighted = [(error, errors.focals[c] ** 2 * slope.T, slope) for c, error, slope in views]
            normal = sum(across @ slope for _, across, slope in weighted)
            inverse = np.linalg.inv(normal + 1e-9 * np.trace(normal) * np.eye(3))
            found[n] = inverse @ sum(across @ error @ across.T for error, across, _ in weighted) @ inverse
    return found


@pytest.mark.parametrize("lens", ["brown", "fisheye"])
def test_the_kernel_gives_the_covariances_of_dense_matrices(lens: str) -> None:
    """Points on both sides of the cameras and of image borders, missing ones, any views."""
    errors, rng = CalibrationErrors.of(uncertain_rig(lens).cameras), np.random.default_rng(5)
    assert errors is not None
    points = rng.uniform(-5.0, 5.0, (400, 3))
    points[::17, 1] = np.nan
    used = rng.random((len(points), 4)) < 0.5
    expected = by_numpy(errors, points, used)
    assert 50 < expected.any(axis=(1, 2)).sum() < 350
    np.testing.assert_allclose(errors.covariances(points, used), expected, rtol=1e-9, atol=1e-18)


@pytest.mark.parametrize("lens", ["brown", "fisheye"])
@pytest.mark.parametrize("views", [(0, 1, 2, 3), (1, 3)])
def test_drawn_rigs_have_the_predicted_errors(lens: str, views: tuple[int, ...]) -> None:
    """Exact pixels, and a rig that is wrong by its covariance: NEES per degree of freedom is 1."""
    rig, rng = uncertain_rig(lens), np.random.default_rng(1)
    pixels = np.stack([rig.cameras[v].project(POINTS)[0] for v in views])
    used = np.zeros((len(POINTS), 4), bool)
    used[:, list(views)] = True
    errors = CalibrationErrors.of(rig.cameras)
    assert errors is not None
    predicted = errors.covariances(POINTS, used)
    off = (
        np.stack(
            [triangulated([drawn(rig.cameras[v], rng) for v in views], pixels, POINTS) for _ in range(RIGS)]
        )
        - POINTS
    )
    squares = np.einsum("rni,nij,rnj->rn", off, np.linalg.inv(predicted), off) / 3.0
    assert BOUNDS[0] < squares.mean() < BOUNDS[1]
    measured = np.einsum("rni,rnj->nij", off, off) / RIGS
    ratios = np.trace(measured, axis1=1, axis2=2) / np.trace(predicted, axis1=1, axis2=2)
    assert 0.75 < ratios.min() and ratios.max() < 1.3


def test_a_rig_without_covariance_adds_nothing() -> None:
    cameras = tuple(replace(camera, covariance=None) for camera in uncertain_rig("brown").cameras)
    assert CalibrationErrors.of(cameras) is None


def test_missing_points_add_nothing_and_too_few_views_stand_for_all() -> None:
    errors = CalibrationErrors.of(uncertain_rig("brown").cameras)
    assert errors is not None
    points = np.array([[np.nan] * 3, [0.1, 0.2, 1.0], [0.1, 0.2, 1.0], [90.0, 0.0, 0.0]])
    used = np.array([4 * [True], 4 * [True], [True, False, False, False], 4 * [True]])
    found = errors.covariances(points, used)
    assert not found[[0, 3]].any()
    assert (found[1] == found[2]).all()
    assert np.linalg.eigvalsh(found[1]).min() > 0.0


def test_people_use_the_views_of_their_2d_poses() -> None:
    errors = CalibrationErrors.of(uncertain_rig("brown").cameras)
    assert errors is not None
    persons = np.array([[0, -1, 1], [-1, -1, -1]])
    found = errors.of_people(np.stack([POINTS, POINTS]), ("c3", "c0", "c1"), persons)
    two = np.tile([False, True, False, True], (len(POINTS), 1))
    np.testing.assert_array_equal(found[0], errors.covariances(POINTS, two))
    np.testing.assert_array_equal(found[1], errors.of_people(POINTS[None], (), None)[0])
