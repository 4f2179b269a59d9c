"""Maps of regions are those of the whole image, wherever the regions lie."""

import cv2
import numpy as np
import pytest

from panoptic_ros.detection.config import DetectionConfig
from panoptic_ros.detection.patch_kernels import raise_levels
from panoptic_ros.detection.people import no_people
from panoptic_ros.detection.region_maps import RegionMaps, merged_maps

PEAKS = [(40.0, 30.0), (100.0, 70.0), (200.0, 50.0)]  # px


def field(columns, rows, grid):
    """A smooth field on a grid."""
    x = (np.arange(columns) - grid[0, 2]) / grid[0, 0]
    y = (np.arange(rows) - grid[1, 2]) / grid[1, 1]
    return sum(np.exp(-((x[None, :] - u) ** 2 + (y[:, None] - w) ** 2) / (2 * 12.0**2)) for u, w in PEAKS)


def part(box, cell):
    """Maps of one joint in a box of the image, with cells of so many px."""
    left, top, right, bottom = box
    x, y = 0.5 / cell - 0.5 - np.array([left, top]) / cell
    grid = np.array([[1 / cell, 0, x], [0, 1 / cell, y]])
    size = int(np.ceil((right - left) / cell)), int(np.ceil((bottom - top) / cell))
    return RegionMaps(field(*size, grid)[None].astype(np.float32), grid, (right, bottom))


def value_at(patches, x, y):
    """The largest patch value at a pixel."""
    column, row = patches.grid_from_image[:, :2] @ (x, y) + patches.grid_from_image[:, 2]
    best = 0.0
    for patch in patches.patches:
        c, r = round(column) - patch.corner[0], round(row) - patch.corner[1]
        if 0 <= r < patch.values.shape[0] and 0 <= c < patch.values.shape[1]:
            best = max(best, patch.values[r, c] / 255)
    return best


@pytest.mark.parametrize(
    "boxes",
    [[(0, 0, 240, 100)], [(0, 0, 130, 100), (150, 10, 240, 100)], [(0, 0, 160, 100), (80, 8, 240, 96)]],
)
@pytest.mark.parametrize("cells", [(4.0, 4.0), (4.0, 5.3), (6.1, 4.0)])
def test_peaks_are_where_they_were(boxes, cells):
    parts = [part(box, cell) for box, cell in zip(boxes, cells)]
    found = merged_maps(parts, no_people(1), DetectionConfig(joint_threshold=0.1))
    for x, y in PEAKS:
        assert value_at(found, x, y) > 0.93
    assert value_at(found, 150.0, 20.0) < 0.06


def test_resampling_is_that_of_opencv():
    maps = np.random.default_rng(3).uniform(0.0, 1.0, (2, 9, 7)).astype(np.float32)
    down, across = 0.83 * np.arange(14) - 1.4, 1.31 * np.arange(9) - 2.2
    cells = np.array([[1.31, 0.0, -2.2], [0.0, 0.83, -1.4]])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    levels = np.zeros((2, 14, 9), np.uint8)
    raise_levels(levels, (0, 0), maps, (9, 7), (down, across), 0.2)
    for plane, found in zip(maps, levels / 255.0):
        expected = cv2.warpAffine(plane, cells, (9, 14), flags=flags)
        assert np.allclose(found[found > 0.0], expected[found > 0.0], atol=0.042)  # 1/32 cell, half a level
        assert ((found > 0.0) | (expected < 0.24)).all() and ((found == 0.0) | (expected > 0.16)).all()
    before = np.full((2, 14, 9), 128, np.uint8)
    raise_levels(before, (0, 0), maps, (9, 7), (down, across), 0.2)
    assert np.array_equal(before, np.maximum(levels, 128))


def test_cells_of_padding_are_not_part_of_the_grid():
    given = part((0, 0, 200, 100), 4.0)
    maps = np.pad(given.maps, ((0, 0), (0, 7), (0, 9)), constant_values=0.7)
    padded = RegionMaps(maps, given.grid_from_image, (200, 100))
    found = merged_maps([padded], no_people(1), DetectionConfig(joint_threshold=0.1))
    assert found.grid_size == (50, 25)
