"""Optical flow of points between two grey images: Lucas and Kanade 1981, in pyramids (Bouguet 2001).

The forward-backward check (Kalal et al. 2010) finds lost points: the backward flow does not lead to their
start. This is the only module that calls OpenCV's tracker.
"""

from __future__ import annotations

import cv2
import numpy as np

Array = np.ndarray
HALF = 5  # px, half window: a forearm is 8 px wide, and a larger window would follow the background
LEVELS = 3  # pyramid levels above the image
LEAST_STEP = 0.03  # px, step below which iterations end


def there_and_back(
    before: Array, now: Array, begins: Array, starts: Array, iterations: int, back_from_begins: bool
) -> tuple[Array, Array, Array]:
    """Follow points of a grey image (h, w) uint8 into the next one, and from there back.

    Args:
        begins: (N, 2) px in the first image.
        starts: (N, 2) px, initial guess in the second image.
        iterations: Greatest number per pyramid level.
        back_from_begins: True: the backward search starts at `begins`, at full resolution only. False: it
            starts at the ends, with the whole pyramid.

    Returns:
        ends (N, 2) px float32, forward-backward error (N,) px, and which points (N,) were found both ways.
    """
    first = np.ascontiguousarray(begins, np.float32)
    ends, found = _moved(before, now, first, np.ascontiguousarray(starts, np.float32), LEVELS, iterations)
    back_starts, levels = (first, 0) if back_from_begins else (ends, LEVELS)
    back, again = _moved(now, before, ends, back_starts, levels, iterations)
    return ends, np.linalg.norm(back - first, axis=1), found & again


def _moved(
    before: Array, now: Array, begins: Array, starts: Array, levels: int, iterations: int
) -> tuple[Array, Array]:
    ends, found, _ = cv2.calcOpticalFlowPyrLK(
        before,
        now,
        begins[:, None],
        starts[:, None].copy(),
        winSize=(2 * HALF + 1, 2 * HALF + 1),
        maxLevel=levels,
        criteria=(cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, iterations, LEAST_STEP),
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )
    return np.asarray(ends)[:, 0], np.asarray(found).ravel() == 1
