"""Triangulation: exact without noise, as precise as its covariance says with noise, robust to outliers."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rays import closest_points, ray_distances

from panoptic_ros.geometry import (
    ProjectionStack,
    Rigid,
    triangulate_linear,
    triangulate_robust,
)


def ring(count=5, radius=4.0, focal=1000.0):
    rotations, translations = [], []
    for k in range(count):
        a = 2 * np.pi * k / count + 0.2
        eye = np.array([radius * np.cos(a), radius * np.sin(a), 1.5 + 0.2 * k])
        z = (np.array([0, 0, 1.0]) - eye) / np.linalg.norm(np.array([0, 0, 1.0]) - eye)
        x = np.cross(z, [0, 0, 1.0]) / np.linalg.norm(np.cross(z, [0, 0, 1.0]))
        rotation = np.stack([x, np.cross(z, x), z])
        rotations.append(rotation)
        translations.append(-rotation @ eye)
    return ProjectionStack(np.array(rotations), np.array(translations), np.full(count, focal))


def project(stack, points):
    local = np.einsum("cij,nj->nci", stack.rotations, points) + stack.translations
    return local[..., :2] / local[..., 2:]


RIG = ring()
POINTS = np.random.default_rng(0).uniform([-1, -1, 0], [1, 1, 2], (200, 3))


def test_exact_observations_give_exact_points():
    plane = project(RIG, POINTS)
    assert np.abs(triangulate_linear(RIG, plane, np.ones(plane.shape[:2])) - POINTS).max() < 1e-9
    result = triangulate_robust(RIG, plane, np.ones(plane.shape[:2]))
    assert np.abs(result.points - POINTS).max() < 1e-9 and result.inliers.all()


def test_covariance_is_honest():
    rng = np.random.default_rng(1)
    sigma = 2.0
    plane = project(RIG, POINTS) + sigma / 1000.0 * rng.standard_normal((len(POINTS), 5, 2))
    result = triangulate_robust(RIG, plane, np.full(plane.shape[:2], sigma), cauchy=1e6, gate=1e6)
    error = result.points - POINTS
    nees = np.einsum("ni,nij,nj->n", error, np.linalg.inv(result.covariances), error)
    assert nees.mean() / 3 == pytest.approx(1.0, abs=0.15)


def test_one_gross_outlier_per_point_does_not_matter():
    rng = np.random.default_rng(2)
    plane = project(RIG, POINTS) + 1e-3 * rng.standard_normal((len(POINTS), 5, 2))
    rows = np.arange(len(POINTS))
    wrong = rng.integers(0, 5, len(POINTS))
    plane[rows, wrong] += 0.1
    result = triangulate_robust(RIG, plane, np.ones(plane.shape[:2]))
    assert np.median(np.linalg.norm(result.points - POINTS, axis=1)) < 0.006
    assert not result.inliers[rows, wrong].any()


def test_fewer_than_two_views_give_nothing():
    plane = project(RIG, POINTS[:2])
    plane[0, 1:] = np.nan
    result = triangulate_robust(RIG, plane, np.ones(plane.shape[:2]))
    assert np.isnan(result.points[0]).all() and np.isnan(result.covariances[0]).all()
    assert np.allclose(result.points[1], POINTS[1])


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10**6), st.permutations(range(5)))
def test_order_of_cameras_and_world_frame_do_not_matter(seed, order):
    rng = np.random.default_rng(seed)
    points = POINTS[:8]
    plane = project(RIG, points) + 1e-3 * rng.standard_normal((8, 5, 2))
    sigmas = rng.uniform(0.5, 3.0, (8, 5))
    expected = triangulate_robust(RIG, plane, sigmas).points
    order = list(order)
    permuted = ProjectionStack(RIG.rotations[order], RIG.translations[order], RIG.focals[order])
    assert np.allclose(triangulate_robust(permuted, plane[:, order], sigmas[:, order]).points, expected)
    q, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    q *= np.sign(np.linalg.det(q))
    new_from_old = Rigid(q, rng.standard_normal(3))
    old_from_new = new_from_old.inverse()
    moved = ProjectionStack(
        RIG.rotations @ old_from_new.rotation,
        RIG.rotations @ old_from_new.translation + RIG.translations,
        RIG.focals,
    )
    assert np.allclose(
        triangulate_robust(moved, plane, sigmas).points, new_from_old.apply(expected), atol=1e-7
    )


def test_rays_meet_where_they_should():
    a, b = np.array([0.0, 0, 0]), np.array([2.0, 0, 1.0])
    x, y = np.array([1.0, 0, 0]), np.array([0.0, 1.0, 0])
    assert ray_distances(a, x, b, y) == pytest.approx(1.0)
    point, depth_a, depth_b = closest_points(a, x, b, y)
    assert np.allclose(point, [2, 0, 0.5]) and (depth_a, depth_b) == (pytest.approx(2.0), pytest.approx(0.0))
    assert ray_distances(a, x, b, x) == pytest.approx(1.0)  # parallel


def test_rigid_transforms_compose_and_invert():
    rng = np.random.default_rng(3)
    q, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    b_from_a = Rigid(q * np.sign(np.linalg.det(q)), rng.standard_normal(3))
    c_from_b = Rigid(np.eye(3), rng.standard_normal(3))
    points = rng.standard_normal((5, 3))
    assert np.allclose(c_from_b.compose(b_from_a).apply(points), c_from_b.apply(b_from_a.apply(points)))
    assert np.allclose(b_from_a.inverse().apply(b_from_a.apply(points)), points)
