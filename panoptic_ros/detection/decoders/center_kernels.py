"""Compiled loops of `center_heads`. They call no function outside this file."""

from __future__ import annotations

import numpy as np

from panoptic_ros.kernels import njit

_jit = njit(cache=True, error_model="numpy")
REACH = 2  # cells: a peak is the maximum of the 5 x 5 cells around it
COUNTED = 0.127  # joints with higher scores count in the person score


@_jit
def people_of(heads, most, threshold, variance):
    """Decode the people of an image, unsorted, in cells.

    Args:
        heads: `center` (h, w), `heat` (K, h, w), `regress` and `offset` (2 K, h, w), `box_scale` and
            `box_offset` (2, h, w), all float32; y before x.
        most: Greatest number of people.
        threshold: Least person score.
        variance: See `decode_center_heads`.

    Returns:
        joints (P, K, 2), joint scores (P, K), person scores (P,), boxes (P, 4) left, top, right, bottom.
    """
    center, heat, regress, offset, box_scale, box_offset = heads
    count, rows, columns = heat.shape
    peaks = _peaks(center, most, threshold)
    joints, scores = np.empty((len(peaks), count, 2)), np.empty((len(peaks), count))
    person_scores, boxes = np.empty(len(peaks)), np.empty((len(peaks), 4))
    found = 0
    for peak in range(len(peaks)):
        y, x = peaks[peak]
        top, bottom = _extent(box_scale[0, y, x], box_offset[0, y, x], y, rows)
        left, right = _extent(box_scale[1, y, x], box_offset[1, y, x], x, columns)
        first_row = min(np.int64(np.ceil(top)), rows - 1)
        first_column = min(np.int64(np.ceil(left)), columns - 1)
        last_row = max(np.int64(np.ceil(bottom)), first_row + 1)
        last_column = max(np.int64(np.ceil(right)), first_column + 1)
        across = np.empty(last_column - first_column)
        total, counted = 0.0, 0
        for k in range(count):
            guess_y = np.float64(regress[2 * k, y, x]) + y
            guess_x = np.float64(regress[2 * k + 1, y, x]) + x
            near_y = _inside(np.rint(guess_y), first_row, last_row)
            near_x = _inside(np.rint(guess_x), first_column, last_column)
            weight = np.exp(-((near_y - guess_y) ** 2) / variance)
            least = heat[k, near_y, near_x] * weight * np.exp(-((near_x - guess_x) ** 2) / variance)
            # cells farther away have a lower weight than the score at the regressed place, so they cannot win
            reach = 1.0 + np.sqrt(-variance * np.log(least)) if 0.0 < least <= 1.0 else np.inf
            left_end = _inside(guess_x - reach, first_column, last_column)
            right_end = _inside(guess_x + reach, first_column, last_column) + 1
            for column in range(left_end, right_end):
                across[column - first_column] = np.exp(-((column - guess_x) ** 2) / variance)
            best, best_row, best_column = -np.inf, first_row, first_column
            for row in range(
                _inside(guess_y - reach, first_row, last_row),
                _inside(guess_y + reach, first_row, last_row) + 1,
            ):
                down = np.exp(-((row - guess_y) ** 2) / variance)
                for column in range(left_end, right_end):
                    value = heat[k, row, column] * down * across[column - first_column]
                    if value > best:
                        best, best_row, best_column = value, row, column
            joints[found, k, 0] = best_column + np.float64(offset[2 * k + 1, best_row, best_column])
            joints[found, k, 1] = best_row + np.float64(offset[2 * k, best_row, best_column])
            scores[found, k] = best
            if best > COUNTED:
                total, counted = total + best, counted + 1
        person_scores[found] = center[y, x] * total / max(counted, 1)
        boxes[found] = (left, top, right, bottom)
        found += person_scores[found] >= threshold
    return joints[:found], scores[:found], person_scores[:found], boxes[:found]


@_jit
def _peaks(center, most, threshold):
    """Return row and column (N, 2) of the best local maxima of a map (h, w), best first."""
    rows, columns = center.shape
    cells, values = np.empty((most, 2), np.int64), np.empty(most)
    count = 0
    for y in range(rows):
        for x in range(columns):
            value = center[y, x]
            if not value >= threshold or (count == most and value <= values[-1]):
                continue
            highest = True
            for row in range(max(y - REACH, 0), min(y + REACH + 1, rows)):
                for column in range(max(x - REACH, 0), min(x + REACH + 1, columns)):
                    highest &= center[row, column] <= value
            if not highest:
                continue
            count = min(count + 1, most)
            at = count - 1
            while at > 0 and values[at - 1] < value:
                values[at], cells[at, 0], cells[at, 1] = values[at - 1], cells[at - 1, 0], cells[at - 1, 1]
                at -= 1
            values[at], cells[at, 0], cells[at, 1] = value, y, x
    return cells[:count]


@_jit
def _inside(place, first, last):
    """Return the cell at `place`, truncated to an integer and clipped to `first` .. `last` - 1."""
    return np.int64(min(max(place, np.float64(first)), np.float64(last - 1)))


@_jit
def _extent(scale, offset, cell, size):
    """Return the begin and end of a box along one axis, clipped to the map."""
    half, middle = 0.5 * max(np.float64(scale), 0.0), np.float64(offset) + cell
    return min(max(middle - half, 0.0), size), min(max(middle + half, 0.0), size)
