"""Points followed from one grey image to another: Lucas and Kanade 1981, in pyramids (Bouguet 2001).

Forward and backward (Kalal et al. 2010): a point that does not come back to where it began is lost. This
is the only module that calls OpenCV's tracker.
"""

from __future__ import annotations

import cv2
import numpy as np

Array = np.ndarray
HALF = 5  # px of the window to each side: a forearm is 8 px wide; a larger one takes the background along
LEVELS = 3  # of the pyramid above the image
LEAST_STEP = 0.03  # px, below which iterations end


def there_and_back(
    before: Array, now: Array, begins: Array, starts: Array, iterations: int, back_from_begins: bool
) -> tuple[Array, Array, Array]:
    """Follow points of a grey image (h, w) uint8 into the next one, and from there back.

    Args:
        begins: (N, 2) px. starts: (N, 2) px, where they are looked for first.
        iterations: per level of the pyramid, at most.
        back_from_begins: look for the way back about the beginnings, in the image alone; else about the ends,
            in the whole pyramid.

    Returns:
        ends (N, 2) px float32, distance (N,) px of the way back from the beginning; which (N,) were found.
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
