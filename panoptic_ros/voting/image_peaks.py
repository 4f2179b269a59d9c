"""2D peaks of all views: local maxima of the score maps, and keypoints of joints without maps."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.kernels import inlined, njit

Array = np.ndarray


class ImagePeaks(NamedTuple):
    """2D peaks (K, 2) px of all views; the first of view v and joint j is start[v * J + j] (V * J + 1)."""

    start: Array
    pixels: Array


@njit(cache=True, error_model="numpy", nogil=True)
def find_peaks(scene, threshold):
    """2D peaks of the joints of a `VoteScene` above a threshold.

    3x3 local maxima of the merged maps: the centroid of the window, weighted by the square of the score. Of
    equal neighbours the first one is the peak, and of patches that lie on each other the first with the
    largest value has it.
    """
    views, joint_count, most, _ = scene.people.shape
    start = np.zeros(views * joint_count + 1, np.int64)
    pixels = np.empty((views * joint_count * most + len(scene.patch_data), 2))  # more than there can be
    total = np.int64(0)  # a literal 0 would be a type of its own, and all parts compiled for it as well
    for v in range(views):
        for j in range(joint_count):
            if scene.map_start[v, j] < 0:
                total = _add_keypoints(scene.people, v, j, threshold, pixels, total)
            else:
                total = _add_map_peaks(scene, v, j, threshold, pixels, total)
            start[v * joint_count + j + 1] = total
    return ImagePeaks(start, pixels[:total].copy())


@inlined
def _add_keypoints(people, v, j, threshold, pixels, total):
    """Write 2D joints above the threshold from pixels[total] on; the new total."""
    for i in range(people.shape[2]):
        if people[v, j, i, 3] > threshold:
            pixels[total, 0], pixels[total, 1] = people[v, j, i, 0], people[v, j, i, 1]
            total += 1
    return total


@inlined
def _add_map_peaks(scene, v, j, threshold, pixels, total):
    """As `_add_keypoints`, the peaks of a map.

    Its patches lie close together in memory, its rows do not: a patch that is alone at a peak is enough.
    """
    data, least = scene.patch_data, int(255.0 * threshold)  # whole numbers compare faster
    key = v * scene.map_start.shape[1] + j
    for k in range(scene.patch_start[key], scene.patch_start[key + 1]):
        _, _, _, width, height, first = _patch(scene, k)
        for y in range(height):
            at = first + y * width
            before, value = np.int64(-1), np.int64(data[at])
            for x in range(width):
                after = np.int64(data[at + x + 1]) if x + 1 < width else np.int64(0)
                if (value > least) & (value > before) & (value >= after):
                    above = int(data[at + x - width]) if y > 0 else -1
                    below = int(data[at + x + width]) if y + 1 < height else 0
                    if above < value >= below:
                        peak, pixels[total, 0], pixels[total, 1] = _peak(scene, v, j, k, (x, y), value)
                        total += peak
                before, value = value, after
    return total


@inlined
def _patch(scene, k):
    """A row of `VoteScene.patch_table`."""
    table = scene.patch_table
    return table[k, 0], table[k, 1], table[k, 2], table[k, 3], table[k, 4], table[k, 5]


@inlined
def _peak(scene, v, j, k, cell, value):
    """Whether a cell of patch k that tops its neighbours in the patch is a peak, and its pixel u, w."""
    _, column, row, width, height, first = _patch(scene, k)
    x, y = cell
    camera = scene.cameras[v]
    if _alone(scene, v, j, k, (column + x, row + y)):
        peak, a, b = _centroid(_Image(scene.patch_data, first, width, height), cell, value)
        a, b = a + column, b + row
    else:
        image = _Image(scene.map_data, scene.map_start[v, j], int(camera.columns), int(camera.rows))
        peak, a, b = _centroid(image, (column + x, row + y), value)
        peak = peak and not _in_earlier_patch(scene, v, j, k, (column + x, row + y), value)
    a, b = a - camera.a2, b - camera.b2
    det = camera.a0 * camera.b1 - camera.a1 * camera.b0
    return peak, (camera.b1 * a - camera.a1 * b) / det, (camera.a0 * b - camera.b0 * a) / det


class _Image(NamedTuple):
    """Rows of `width` values that begin at data[first]."""

    data: Array
    first: int
    width: int
    height: int


@inlined
def _alone(scene, v, j, k, cell):
    """Whether no patch of a view and joint but k has a cell in the 3x3 window about a cell."""
    x, y = cell
    key, alone = v * scene.map_start.shape[1] + j, True
    for other in range(scene.patch_start[key], scene.patch_start[key + 1]):
        _, column, row, width, height, _ = _patch(scene, other)
        beside = (column <= x + 1) & (x <= column + width) & (row <= y + 1) & (y <= row + height)
        alone &= (other == k) | (not beside)
    return alone


@inlined
def _centroid(image, cell, value):
    """Whether a cell is a peak of this value, and the centroid x, y of the window about it."""
    x, y = cell
    total, sum_x, sum_y, peak = 0, 0, 0, True
    for step in range(9):
        a, b = x + step % 3 - 1, y + step // 3 - 1
        inside = (a >= 0) & (a < image.width) & (b >= 0) & (b < image.height)
        other = int(image.data[image.first + b * image.width + a]) if inside else 0
        peak &= other < value or (step >= 4 and other == value)
        total, sum_x, sum_y = total + other * other, sum_x + other * other * a, sum_y + other * other * b
    return peak, sum_x / total, sum_y / total


@inlined
def _in_earlier_patch(scene, v, j, k, cell, value):
    """Whether a patch of a view and joint before k has this value at a cell."""
    x, y = cell
    for other in range(scene.patch_start[v * scene.map_start.shape[1] + j], k):
        _, column, row, width, height, first = _patch(scene, other)
        if column <= x < column + width and row <= y < row + height:
            if scene.patch_data[first + (y - row) * width + x - column] == value:
                return True
    return False
