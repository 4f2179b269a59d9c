"""What stands between: walls, tables, edges, and what goes on to later stages."""

from dataclasses import replace

import numpy as np
import pytest

from panoptic_ros.association.known_occluders import MARGIN, nearest_depths, occluded_depths
from panoptic_ros.domain import Camera, Occluders, VisibilityLimit
from panoptic_ros.geometry import Intrinsics, Rigid

LENS = (-0.2, 0.05, 0.001, -0.002, 0.01)
FORWARD = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])  # looks along x, z up


FISHEYE = Intrinsics(np.eye(3), (0.02, -0.01, 0.003, -0.001), "fisheye")


def camera(distortion=()):
    matrix = np.array([[500.0, 0.0, 319.5], [0.0, 500.0, 239.5], [0.0, 0.0, 1.0]])
    centre = np.array([0.0, 0.0, 1.0])
    straight = distortion if isinstance(distortion, Intrinsics) else Intrinsics(matrix, distortion)
    return Camera("cam", (640, 480), replace(straight, matrix=matrix), Rigid(FORWARD, -FORWARD @ centre))


def blocked_by_ray(camera, box, points):
    """Whether the straight line from the camera meets an axis-aligned box before the points."""
    low, high = box
    direction = points - camera.centre
    with np.errstate(divide="ignore"):
        first, last = (low - camera.centre) / direction, (high - camera.centre) / direction
    near, far = np.minimum(first, last).max(axis=1), np.maximum(first, last).min(axis=1)
    return (near < far) & (near < 1.0) & (far > 0.0)


@pytest.mark.parametrize("distortion", [(), LENS, FISHEYE])
def test_a_wall_hides_what_is_behind_it_and_nothing_else(distortion):
    eye = camera(distortion)
    size, centre = np.array([0.2, 1.6, 2.0]), np.array([2.1, 0.3, 0.9])
    wall = Occluders.box(size, np.eye(3), centre)
    depths = occluded_depths(eye, wall)
    limit = VisibilityLimit.of_depths(depths, 0.0)
    points = np.random.default_rng(0).uniform([0.5, -2.0, -0.5], [4.0, 2.0, 2.5], (4000, 3))
    pixels, ahead = eye.project(points)
    inside = ahead & eye.contains(pixels)
    points, pixels = points[inside], pixels[inside]
    seen = limit.sees(pixels, eye.cam_from_world.apply(points)[:, 2], eye.image_size)
    halves = (size / 2 + 0.03, size / 2 - 0.03)
    grown, shrunk = (blocked_by_ray(eye, (centre - half, centre + half), points) for half in halves)
    assert seen[~grown].all()
    assert not seen[shrunk & (points[:, 0] > 2.25)].any()
    assert seen.sum() > 500 and (~seen).sum() > 300


def test_a_tilted_surface_hides_by_its_depth_in_every_cell():
    eye = camera()
    corners = np.array([[2.0, -9.0, -9.0], [2.0, 9.0, -9.0], [6.0, 0.0, 20.0]])  # x grows with z
    depths = occluded_depths(eye, Occluders(corners, [[0, 1, 2]]))
    assert np.isfinite(depths).all()
    below, above = depths[-1, 80], depths[0, 80]
    slope = 4.0 / 29.0
    for depth, ray in ((below, 239.5 / 500.0), (above, -240.5 / 500.0)):
        assert depth == pytest.approx((2.0 + 10.0 * slope) / (1.0 + slope * ray), rel=0.01)


def test_cells_across_an_edge_see_on():
    eye = camera()
    edge = Occluders.box((0.01, 2.0, 4.0), np.eye(3), (2.0, 1.004, 1.0))  # y >= 0.004: about 1 px
    depths = occluded_depths(eye, edge)
    assert np.isinf(depths[:, 79:]).all() and np.isfinite(depths[:, 78]).all()


def test_a_thing_behind_the_camera_hides_nothing():
    behind = Occluders.box((0.5, 1.0, 1.0), np.eye(3), (-2.0, 0.0, 1.0))
    assert np.isinf(occluded_depths(camera(), behind)).all()


def test_a_table_hides_the_legs_under_it_and_not_the_hands_on_it():
    eye = camera()
    high = replace(eye, cam_from_world=Rigid(FORWARD, -FORWARD @ np.array([0.0, 0.0, 2.2])))
    table = Occluders.box((1.2, 2.0, 0.04), np.eye(3), (4.4, 0.0, 0.70))
    limit = VisibilityLimit.of_depths(occluded_depths(high, table), MARGIN)
    places = {
        "hand": (4.3, 0.1, 0.75),
        "head": (5.2, 0.0, 1.2),
        "hip": (5.3, 0.0, 0.55),
        "knee": (5.0, 0.1, 0.48),
        "ankle": (5.6, 0.1, 0.08),
        "foot before it": (4.6, 0.3, 0.05),
        "ankle beside it": (4.6, 1.7, 0.08),
    }
    points = np.array(list(places.values()))
    pixels, _ = high.project(points)
    assert high.contains(pixels).all()
    seen = limit.sees(pixels, high.cam_from_world.apply(points)[:, 2], high.image_size)
    assert [name for name, sees in zip(places, seen) if not sees] == ["hip", "knee", "ankle"]


def test_first_hits_are_those_of_solving_for_every_ray_and_triangle():
    rng = np.random.default_rng(0)
    plane = rng.normal(0.0, 0.6, (20, 30, 2))
    plane[3, 4] = np.nan
    triangles = 0.4 * rng.normal(size=(40, 3, 3)) + rng.normal(size=(40, 1, 3)) + (0.0, 0.0, 1.0)
    expected = np.full((20, 30), np.inf)
    rays = np.concatenate([np.nan_to_num(plane), np.ones((20, 30, 1))], axis=-1)
    for a, b, c in triangles:
        sides = np.stack([np.broadcast_to(b - a, rays.shape), np.broadcast_to(c - a, rays.shape), -rays], -1)
        ends = np.broadcast_to(-a, rays.shape)[..., None]
        u, v, depth = np.moveaxis(np.linalg.solve(sides, ends)[..., 0], -1, 0)
        hit = (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (depth > 1e-3)
        expected = np.where(hit, np.minimum(expected, depth), expected)
    expected[3, 4] = np.inf
    assert 0.2 < np.isinf(expected).mean() < 0.8
    assert nearest_depths(plane, triangles) == pytest.approx(expected)
