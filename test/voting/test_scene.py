"""The arrays of a scene against what they mean."""

import numpy as np
import pytest
from score_fields import keypoint_widths

from panoptic_ros.domain import Camera, ScoreMaps, ViewDetections
from panoptic_ros.geometry import Intrinsics, Rigid
from panoptic_ros.voting.scene import KEYPOINT_WIDTH, PERSON_GATE, build_scene

CAMERA = Camera("a", (60, 30), Intrinsics(np.diag([50.0, 50.0, 1.0]), np.zeros(5)), Rigid.identity())


def view_of(points, scores, maps=None):
    people = np.ones(len(points))
    return ViewDetections("a", 0, 0, CAMERA.image_size, "x", points, scores, people, maps)


def random_maps(rng, grid=(14, 11), joints=3):
    patches = rng.integers(0, 12)
    sizes = np.column_stack([rng.integers(1, 8, patches), rng.integers(1, 8, patches)])
    corners = np.column_stack([rng.integers(0, grid[k] - sizes[:, k] + 1) for k in range(2)])
    data = rng.integers(0, 256, int(sizes.prod(1).sum()))
    affine = np.array([[0.25, 0.0, -0.375], [0.0, 0.5, 0.25]])
    return ScoreMaps(
        grid, affine, rng.integers(0, joints, patches), rng.integers(-1, 3, patches), corners, sizes, data
    )


@pytest.mark.parametrize("seed", range(8))
def test_patches_are_merged_to_the_dense_maps(seed):
    rng = np.random.default_rng(seed)
    maps = [random_maps(rng), None, random_maps(rng, (9, 8))]
    views = [view_of(np.zeros((3, 3, 2)), np.zeros((3, 3)), each) for each in maps]
    scene = build_scene([CAMERA] * 3, views, 3)
    for v, each in enumerate(maps):
        for j in range(3):
            start, key = scene.map_start[v, j], 3 * v + j
            mine = scene.patch_table[scene.patch_start[key] : scene.patch_start[key + 1]]
            if each is None or not (each.joints == j).any():
                assert start == -1 and len(mine) == 0
                continue
            columns, rows = each.grid_size
            dense = scene.map_data[start : start + columns * rows].reshape(rows, columns)
            assert np.array_equal(dense, each.dense(3)[j])
            assert np.array_equal(mine[:, 0], each.persons[each.joints == j])
            for _, x, y, w, h, first in mine:
                patch = scene.patch_data[first : first + w * h].reshape(h, w)
                assert (patch <= dense[y : y + h, x : x + w]).all() and len(patch) == h


@pytest.mark.parametrize("seed", range(4))
def test_gaussians_are_as_wide_as_their_people_are_large(seed):
    rng = np.random.default_rng(seed)
    views = []
    for count in (2, 0, 3):
        scores = rng.uniform(0.1, 1.0, (count, 5)) * (rng.random((count, 5)) < 0.7)
        points = rng.uniform(0.0, 60.0, (count, 5, 2))
        points[scores == 0.0] = np.nan
        views.append(view_of(points, scores))
    scene = build_scene([CAMERA] * 3, views, 5)
    assert scene.people.shape == (3, 5, 3, 4) and scene.gates.shape == (3, 3)
    for v, view in enumerate(views):
        widths, count = keypoint_widths(view.points, view.image_size, KEYPOINT_WIDTH), len(view.points)
        mine = scene.people[v].swapaxes(0, 1)
        assert np.array_equal(mine[:count, :, :2], view.points, equal_nan=True)
        assert np.array_equal(mine[:count, :, 3], view.scores)
        assert mine[:count, :, 2] == pytest.approx(np.tile(0.5 / widths[:, None] ** 2, 5), rel=1e-12)
        assert scene.gates[v, :count] == pytest.approx((PERSON_GATE * widths) ** 2, rel=1e-12)
        assert np.isnan(mine[count:, :, :2]).all() and (mine[count:, :, 2:] == 0.0).all()
