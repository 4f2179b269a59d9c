"""The compiled loops of `score_maps`. They call nothing outside of this file."""
from __future__ import annotations

import numpy as np

from panoptic_ros.kernels import njit

_jit = njit(cache=True, error_model="numpy")
NOBODY = -1


@_jit
def claimed(levels, cells, seen, radius):
    """What people claim of maps: each cell goes to the nearest joint in whose gate it lies.

    Args:
        levels: (K, h, w) uint8; claimed cells are 0 afterwards.
        cells: (P, K, 2) column and row of joints. seen: (P, K) whether they count. radius: (P,) cells.

    Returns:
        rows (N, 7): joint, person, left, top, width, height, and where its values begin in the data; by
        person, then joint. Data uint8, of one window after the other.
    """
    people, joints = seen.shape
    owners = np.full(levels.shape, NOBODY, np.int16)
    nearest = np.full(levels.shape, np.inf, np.float32)
    room = 0
    for joint in range(joints):
        for person in range(people):
            if seen[person, joint]:
                left, top, right, bottom = _window(cells[person, joint], radius[person], levels.shape)
                room += max(right - left, 0) * max(bottom - top, 0)
                limit = radius[person] ** 2
                for y in range(top, bottom):
                    down = (y - cells[person, joint, 1]) ** 2
                    for x in range(left, right):
                        distance = np.float32(down + (x - cells[person, joint, 0]) ** 2)
                        if np.float64(distance) <= limit and distance < nearest[joint, y, x]:
                            nearest[joint, y, x] = distance
                            owners[joint, y, x] = person
    rows, data = np.empty((people * joints, 7), np.int64), np.empty(room, np.uint8)
    count = used = 0
    for person in range(people):
        for joint in range(joints):
            if not seen[person, joint]:
                continue
            left, top, right, bottom = _window(cells[person, joint], radius[person], levels.shape)
            first_x, last_x, first_y, last_y = levels.shape[2], -1, levels.shape[1], -1
            for y in range(top, bottom):
                for x in range(left, right):
                    if owners[joint, y, x] == person and levels[joint, y, x]:
                        first_x, last_x = min(first_x, x), max(last_x, x)
                        first_y, last_y = min(first_y, y), y
            if last_y < first_y:
                continue
            rows[count] = (
                joint, person, first_x, first_y, last_x - first_x + 1, last_y - first_y + 1, used,
            )  # fmt: skip
            count += 1
            for y in range(first_y, last_y + 1):
                for x in range(first_x, last_x + 1):
                    own = owners[joint, y, x] == person
                    data[used] = levels[joint, y, x] if own else 0
                    used += 1
                    if own:
                        levels[joint, y, x] = 0
    return rows[:count], data[:used]


@_jit
def _window(place, radius, shape):
    """Left, top, right, bottom of the cells within `radius` of a place, inside the map (K, h, w)."""
    left, top = max(np.int64(np.ceil(place[0] - radius)), 0), max(np.int64(np.ceil(place[1] - radius)), 0)
    right = min(np.int64(np.floor(place[0] + radius)) + 1, shape[2])
    bottom = min(np.int64(np.floor(place[1] + radius)) + 1, shape[1])
    return left, top, right, bottom
