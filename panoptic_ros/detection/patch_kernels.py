"""Compiled loops of `score_maps`. They call no function outside this file."""

from __future__ import annotations

import numpy as np

from panoptic_ros.kernels import njit

_jit = njit(cache=True, error_model="numpy")
NOBODY = -1


@_jit
def levels_of(maps, cut):
    """Quantise maps (K, h, w) float32 in 0..1 to uint8 in 0..255; values below `cut` become 0."""
    levels = np.zeros(maps.shape, np.uint8)
    one, whole = np.float32(1.0), np.float32(255.0)
    for joint in range(maps.shape[0]):
        for row in range(maps.shape[1]):
            for column in range(maps.shape[2]):
                value = maps[joint, row, column]
                if value >= cut and value > 0.0:
                    levels[joint, row, column] = np.uint8(np.rint(min(value, one) * whole))
    return levels


@_jit
def patches_of(levels, cells, seen, radius):
    """Cut maps into patches: the cells of each person, then the connected blobs of the rest (8 neighbours).

    Args and returns are those of `claimed`, but the maps stay unchanged. Blobs have person -1: they belong to
    no person.
    """
    rest = levels.copy()
    rows, data = claimed(rest, cells, seen, radius)
    more, others = _blobs(rest)
    for row in range(len(more)):
        more[row, 6] += len(data)
    return np.concatenate((rows, more)), np.concatenate((data, others))


@_jit
def _blobs(levels):
    """Return the rows and data of the connected blobs of maps (K, h, w), and set the maps to 0."""
    joints, height, width = levels.shape
    most = 0
    cells = levels.reshape(-1)
    for i in range(len(cells)):
        most += cells[i] > 0
    queue, values = np.empty((most, 2), np.int64), np.empty(most, np.uint8)
    ends, rows = np.empty(most, np.int64), np.empty((most, 7), np.int64)
    last = count = room = 0
    for joint in range(joints):
        for y in range(height):
            for x in range(width):
                if not levels[joint, y, x]:
                    continue
                at = last
                queue[last, 0], queue[last, 1], values[last] = y, x, levels[joint, y, x]
                levels[joint, y, x] = 0
                last += 1
                top, left, bottom, right = y, x, y, x
                while at < last:
                    row, column = queue[at]
                    top, bottom = min(top, row), max(bottom, row)
                    left, right = min(left, column), max(right, column)
                    for beside in range(max(row - 1, 0), min(row + 2, height)):
                        for near in range(max(column - 1, 0), min(column + 2, width)):
                            if levels[joint, beside, near]:
                                queue[last, 0], queue[last, 1] = beside, near
                                values[last] = levels[joint, beside, near]
                                levels[joint, beside, near] = 0
                                last += 1
                    at += 1
                rows[count] = (joint, NOBODY, left, top, right - left + 1, bottom - top + 1, room)
                room += rows[count, 4] * rows[count, 5]
                ends[count] = last
                count += 1
    data = np.zeros(room, np.uint8)
    at = 0
    for blob in range(count):
        while at < ends[blob]:
            row, column = queue[at, 0] - rows[blob, 3], queue[at, 1] - rows[blob, 2]
            data[rows[blob, 6] + row * rows[blob, 4] + column] = values[at]
            at += 1
    return rows[:count], data


@_jit
def claimed(levels, cells, seen, radius):
    """Cut the cells of each person out of the maps. A cell goes to the nearest joint whose gate contains it.

    Args:
        levels: (K, h, w) uint8. Assigned cells are set to 0.
        cells: (P, K, 2) column and row of each joint.
        seen: (P, K) which joints count.
        radius: (P,) gate radius in cells.

    Returns:
        rows: (N, 7) joint, person, left, top, width, height, index of the first value in the data. Sorted by
            person, then by joint.
        data: uint8 values, one window after the other.
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
                joint,
                person,
                first_x,
                first_y,
                last_x - first_x + 1,
                last_y - first_y + 1,
                used,
            )
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
    """Return left, top, right, bottom of the cells within `radius` of `place` in the map (K, h, w)."""
    left, top = max(np.int64(np.ceil(place[0] - radius)), 0), max(np.int64(np.ceil(place[1] - radius)), 0)
    right = min(np.int64(np.floor(place[0] + radius)) + 1, shape[2])
    bottom = min(np.int64(np.floor(place[1] + radius)) + 1, shape[1])
    return left, top, right, bottom


@_jit
def raise_levels(levels, corner, maps, used, places, cut):
    """Raise levels (K, H, W) uint8 to those of maps (K, h, w) float32 that are resampled bilinearly.

    Args:
        corner: Row and column of the first level that may rise.
        used: Number of rows and columns of the maps that count. Values beyond them are 0.
        places: Rows and columns in the maps of the rows and columns of levels from the corner on.
        cut: Values below it become 0.
    """
    rows, row_shares = _neighbours(places[0], used[0])
    columns, column_shares = _neighbours(places[1], used[1])
    above, below = np.zeros(used[1] + 2, np.float32), np.zeros(used[1] + 2, np.float32)
    least, peaks = np.float32(cut), np.zeros(used[0] + 2, np.float32)  # row peaks, padded
    for joint in range(maps.shape[0]):
        for row in range(used[0]):
            peaks[row + 1] = _peak(maps[joint, row], used[1])
        for y in range(len(rows)):
            if max(peaks[rows[y]], peaks[rows[y] + 1]) < least:
                continue
            above[:], below[:] = 0.0, 0.0
            if rows[y] > 0:
                above[1:-1] = maps[joint, rows[y] - 1, : used[1]]
            if rows[y] < used[0]:
                below[1:-1] = maps[joint, rows[y], : used[1]]
            for x in range(len(above)):
                above[x] += row_shares[y] * (below[x] - above[x])
            for x in range(len(columns)):
                value = above[columns[x]]
                value += column_shares[x] * (above[columns[x] + 1] - value)
                if value >= least:
                    level = np.uint8(np.rint(min(value, np.float32(1.0)) * np.float32(255.0)))
                    row, column = corner[0] + y, corner[1] + x
                    levels[joint, row, column] = max(levels[joint, row, column], level)


@_jit
def _peak(row, count):
    """Return the largest of the first `count` values of a row float32, or 0 if all are negative."""
    peak = np.float32(0.0)
    for x in range(count):
        peak = max(peak, row[x])
    return peak


@_jit
def _neighbours(places, count):
    """Return the left neighbour and the interpolation weight of places (N,) in a row of `count` cells.

    The row is padded with one cell on each side.

    Returns:
        index (N,) of the cell before each place, in the padded row; weight (N,) float32 of the cell after it.
    """
    before, shares = np.empty(len(places), np.int64), np.empty(len(places), np.float32)
    for i in range(len(places)):
        inside = min(max(places[i], -1.0), np.float64(count)) + 1.0
        before[i] = min(np.int64(inside), count)
        shares[i] = inside - before[i]
    return before, shares
