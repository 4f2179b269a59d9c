import numpy as np
import pytest

from panoptic_ros.domain import Camera, ScoreMaps, ViewDetections
from panoptic_ros.geometry import Intrinsics, Rigid
from panoptic_ros.voting.peaks import find_peaks
from panoptic_ros.voting.scene import build_scene

AFFINE = np.array([[0.25, 0.0, -0.375], [0.0, 0.5, 0.25]])


def random_maps(rng, grid=(14, 11), patches=9, joints=3):
    sizes = np.column_stack([rng.integers(1, 8, patches), rng.integers(1, 8, patches)])
    corners = np.column_stack([rng.integers(0, grid[k] - sizes[:, k] + 1) for k in range(2)])
    data = rng.integers(0, 6, int(sizes.prod(1).sum())) * 50  # few levels: many equal neighbours
    return ScoreMaps(
        grid, AFFINE, rng.integers(0, joints, patches), np.full(patches, -1), corners, sizes, data
    )


def scene_of(maps, joints=3):
    camera = Camera("a", (60, 30), Intrinsics(np.diag([50.0, 50.0, 1.0]), np.zeros(5)), Rigid.identity())
    view = ViewDetections("a", 0, 0, (60, 30), "x", np.zeros((0, joints, 2)), np.zeros((0, joints)), (), maps)
    return build_scene([camera, camera], [view, view], joints)


def brute_force_peaks(image, threshold):
    """Cells above the threshold that are larger than those before them and not smaller than those after."""
    found = []
    for y, x in np.ndindex(image.shape):
        window = [
            (image[b, a], (b, a))
            for b in range(max(y - 1, 0), min(y + 2, image.shape[0]))
            for a in range(max(x - 1, 0), min(x + 2, image.shape[1]))
            if (a, b) != (x, y)
        ]
        before = all(value < image[y, x] for value, at in window if at < (y, x))
        after = all(value <= image[y, x] for value, at in window if at > (y, x))
        if image[y, x] > 255 * threshold and before and after:
            found.append((x, y))
    return found


@pytest.mark.parametrize("seed", range(8))
def test_peaks_are_the_local_maxima_of_the_merged_maps(seed):
    maps = random_maps(np.random.default_rng(seed))
    start, pixels = find_peaks(scene_of(maps), 0.3)
    dense = maps.dense(3)
    for v in range(2):
        for j in range(3):
            found = pixels[start[3 * v + j] : start[3 * v + j + 1]] @ AFFINE[:, :2].T + AFFINE[:, 2]
            expected = brute_force_peaks(dense[j], 0.3)
            assert len(found) == len(expected)
            for x, y in expected:  # a centroid stays within its window
                assert (np.abs(found - (x, y)).max(axis=1) < 1.0).any()


def test_the_centroid_of_a_symmetric_peak_is_its_middle(scenes):
    grid, at = (40, 30), np.array([[[61.5, 23.5]]])  # cell (15, 12)
    maps = scenes.draw(at, np.ones((1, 1)), grid, AFFINE, [0])
    start, pixels = find_peaks(scene_of(maps, 1), 0.1)
    assert start.tolist() == [0, 1, 2]
    assert pixels[0] == pytest.approx(at[0, 0], abs=1e-9)
