"""2D peaks of all views: local maxima of the score maps, and keypoints of joints without maps."""
from __future__ import annotations

import numpy as np

from panoptic_ros.kernels import njit

_jit = njit(cache=True, error_model="numpy", nogil=True)


@_jit
def find_peaks(scene, threshold):
    """2D peaks of the joints of a `VoteScene` above a threshold.

    3x3 local maxima of the merged maps: the centroid of the window, weighted by the square of the score. Of
    equal neighbours the first one is the peak, and of patches that lie on each other the first with the
    largest value has it.

    Returns:
        start (V * J + 1), the first peak of (v, j) being start[v * J + j]; pixels (K, 2).
    """
    people, map_start = scene.people, scene.map_start
    views, joint_count, most, _ = people.shape
    start = np.zeros(views * joint_count + 1, np.int64)
    pixels = np.empty((views * joint_count * most + len(scene.patch_data), 2))  # more than there can be
    total = 0
    for v in range(views):
        for j in range(joint_count):
            if map_start[v, j] < 0:
                total = _add_keypoints(people[v, j], threshold, pixels, total)
            else:
                total = _add_map_peaks(scene, v, j, threshold, pixels, total)
            start[v * joint_count + j + 1] = total
    return start, pixels[:total].copy()


@_jit
def _add_keypoints(people, threshold, pixels, total):
    """Write those of keypoints (P, 4) above the threshold from pixels[total] on; the new total."""
    for i in range(len(people)):
        if people[i, 3] > threshold:
            pixels[total, 0], pixels[total, 1] = people[i, 0], people[i, 1]
            total += 1
    return total


@_jit
def _add_map_peaks(scene, v, j, threshold, pixels, total):
    """As `_add_keypoints`, the peaks of a map.

    Its patches lie close together in memory, its rows do not: a patch that is alone at a peak is enough.
    """
    cameras, patches, data = scene.cameras, scene.patch_table, scene.patch_data
    least = int(255.0 * threshold)  # whole numbers compare faster
    width, height, begin = int(cameras[v].columns), int(cameras[v].rows), scene.map_start[v, j]
    first = scene.patch_start[v * scene.map_start.shape[1] + j]
    last = scene.patch_start[v * scene.map_start.shape[1] + j + 1]
    for k in range(first, last):
        column, row, w, h, start = patches[k, 1:]
        for y in range(h):
            for x in range(w):
                value = data[start + y * w + x]
                if value <= least or not _tops_neighbours(data, start, w, h, x, y, value):
                    continue
                a, b = column + x, row + y
                if _alone(patches, first, last, k, a, b):
                    peak, place_x, place_y = _centroid(data, start, w, h, x, y, value)
                    place_x, place_y = place_x + column, place_y + row
                else:
                    peak, place_x, place_y = _centroid(scene.map_data, begin, width, height, a, b, value)
                    peak = peak and not _in_earlier_patch(patches, data, first, k, a, b, value)
                if peak:
                    pixels[total] = _pixel(cameras[v], place_x, place_y)
                    total += 1
    return total


@_jit
def _tops_neighbours(data, start, width, height, x, y, value):
    """Whether a cell, with its value, beats the four next to it in an image of this width and height."""
    at = start + y * width + x
    return not (
        (x > 0 and data[at - 1] >= value) or (x < width - 1 and data[at + 1] > value)
        or (y > 0 and data[at - width] >= value) or (y < height - 1 and data[at + width] > value)
    )  # fmt: skip


@_jit
def _alone(patches, first, last, k, x, y):
    """Whether none of the patches first..last but k has a cell in the 3x3 window about a cell."""
    for other in range(first, last):
        column, row, w, h = patches[other, 1:5]
        if other != k and column <= x + 1 and x <= column + w and row <= y + 1 and y <= row + h:
            return False
    return True


@_jit
def _centroid(data, start, width, height, x, y, value):
    """Whether a cell of an image is a peak of this value, and the centroid x, y of the window about it."""
    total, sum_x, sum_y = 0.0, 0.0, 0.0
    for b in range(max(y - 1, 0), min(y + 2, height)):
        for a in range(max(x - 1, 0), min(x + 2, width)):
            other = data[start + b * width + a]
            earlier = b < y or (b == y and a < x)
            if other > value or (earlier and other == value):
                return False, 0.0, 0.0
            weight = float(other) ** 2
            total += weight
            sum_x += weight * a
            sum_y += weight * b
    return True, sum_x / total, sum_y / total


@_jit
def _in_earlier_patch(patches, data, first, k, x, y, value):
    """Whether a patch of first..k has this value at a cell."""
    for other in range(first, k):
        column, row, w, h, begin = patches[other, 1:]
        if column <= x < column + w and row <= y < row + h:
            if data[begin + (y - row) * w + x - column] == value:
                return True
    return False


@_jit
def _pixel(camera, a, b):
    """The pixel of a cell."""
    ax, ay, bx, by = camera.a0, camera.a1, camera.b0, camera.b1
    a, b = a - camera.a2, b - camera.b2
    det = ax * by - ay * bx
    return (by * a - ay * b) / det, (ax * b - bx * a) / det
