"""The quad tree of an image against recursion, and its blobs."""

import captures
import numpy as np
import pytest

from panoptic_ros.continuous.elhayek.quad_tree import (
    LEAST_LEVEL,
    LEVELS,
    SPREAD,
    colours_of,
    image_blobs,
    leaves,
)


def recursive(colours, x, y, level):
    """Leaves of a square (x, y, level), by the definition."""
    side = 2**level
    square = colours[y : y + side, x : x + side].reshape(-1, 3)
    spread = np.sqrt(((square - square.mean(axis=0)) ** 2).sum(axis=1).mean())
    if spread <= SPREAD or level == LEAST_LEVEL:
        return {(x, y, level): square.mean(axis=0)}
    half = side // 2
    return {
        key: mean
        for dx in (0, half)
        for dy in (0, half)
        for key, mean in recursive(colours, x + dx, y + dy, level - 1).items()
    }


def test_leaves_are_those_of_recursion():
    rng = np.random.default_rng(0)
    colours = rng.normal(0.4, 0.01, (48, 64, 3))
    colours[10:30, 20:33] += 0.3
    colours[40:, :9] += rng.normal(0.0, 0.1, (8, 9, 3))
    side = 2 ** (LEVELS - 1)
    expected = {}
    for y in range(0, 48, side):
        for x in range(0, 64, side):
            expected |= recursive(colours, x, y, LEVELS - 1)
    corners, levels, means = leaves(colours)
    found = {(*corner, level): mean for corner, level, mean in zip(corners.tolist(), levels.tolist(), means)}
    assert found.keys() == expected.keys() and len(set(levels.tolist())) == LEVELS - LEAST_LEVEL
    for key, mean in expected.items():
        assert found[key] == pytest.approx(mean)


def test_leaves_of_a_size_that_is_no_multiple_cover_the_image():
    corners, levels, _ = leaves(np.random.default_rng(1).random((37, 50, 3)))
    covered = np.zeros((64, 64), int)
    for (x, y), level in zip(corners, levels):
        covered[y : y + 2**level, x : x + 2**level] += 1
    assert (covered[:37, :50] == 1).all() and covered.max() == 1


def test_blobs_are_where_the_camera_sees_the_point():
    camera = captures.RIG.cameras[0]
    image = np.full((720, 1280, 3), 90, np.uint8)
    point = np.array([[0.3, -0.4, 1.3]])
    ((u, v),) = np.rint(camera.project(point)[0]).astype(int)
    image[v - 12 : v + 13, u - 12 : u + 13] = (40, 40, 220)
    blobs = image_blobs(image, camera)
    local = camera.cam_from_world.apply(point)[0]
    red = blobs.colours[:, 0] > 0.6
    weights = blobs.sigmas[red] ** 2
    assert weights @ blobs.means[red] / weights.sum() == pytest.approx(local[:2] / local[2], abs=2e-3)
    # a square of side s has standard deviation s / 2
    assert 2.0 * np.sqrt((blobs.sigmas[red] ** 2).sum()) * 800.0 == pytest.approx(25.0, rel=0.25)


def test_the_distance_of_colours_does_not_depend_on_where_hues_begin():
    reds = np.array([[(40, 40, 200), (46, 40, 200), (40, 46, 200), (90, 90, 90), (90, 92, 90)]], np.uint8)
    first, second, third, grey, greenish = colours_of(reds)[0]
    assert np.linalg.norm(first - second) == pytest.approx(np.linalg.norm(first - third), rel=0.01)
    assert np.linalg.norm(second - third) < 0.1 and np.linalg.norm(grey - greenish) < 0.05
    dark = colours_of(np.array([[(0, 0, 3), (3, 0, 0)]], np.uint8))[0]
    assert np.linalg.norm(dark[0] - dark[1]) < 0.5  # the hue of almost black counts little
