"""Points from one image to the next, forward and back, see `geometry.optical_flow`.

Every point comes with the inverse covariance of where it went: the structure tensor of its window over the
noise of grey values (Foerstner and Guelch 1987), with a floor, less where it does not come back to where it
began (Kalal et al. 2010). An edge tells the motion across it, and no more.
"""

from __future__ import annotations

import cv2
import numpy as np

from panoptic_ros.geometry.optical_flow import HALF, there_and_back
from panoptic_ros.kernels import njit

Array = np.ndarray
ITERATIONS = 10  # of flow per level
RETURN = 0.5  # px, by which a point that is followed well misses its beginning
FARTHEST_RETURN = 2.0  # px, beyond which it is lost
GREY_VARIANCE = 64.0  # of grey values between the images, with what correlates them in a window
FLOOR = 0.15**2  # px^2, variance of the best
MARGIN = 48  # px round the points, of the part of the images that is looked at
STEP, DARK = 8, 16  # px between those that tell exposure; grey values from which on they do
SAME = 0.02  # share by which exposure may change between two images and be left as it is


def ready() -> None:
    """Compile, or take from the cache."""
    _information(
        np.zeros((16, 16), np.uint8),
        np.full((1, 2), 8, np.float32),
        np.zeros(1, np.float32),
        np.empty((1, 3)),
    )


def followed(before: Array, now: Array, begins: Array, starts: Array) -> tuple[Array, Array, Array]:
    """Where points (N, 2) px of a grey image (h, w) uint8 are in the next one.

    Args:
        starts: (N, 2) px, where they are looked for first.

    Returns:
        ends (M, 2) px, information (M, 3) px^-2 (xx, xy, yy), and which of the points (M,) were found.
    """
    height, width = before.shape
    inside = ((begins >= HALF) & (begins < (width - HALF, height - HALF))).all(axis=1)
    kept = np.flatnonzero(inside)
    if not len(kept):
        return np.zeros((0, 2)), np.zeros((0, 3)), kept
    begins, starts = begins[kept], starts[kept]
    low = np.maximum(np.floor(np.minimum(begins, starts).min(axis=0)) - MARGIN, 0).astype(int)
    high = (np.ceil(np.maximum(begins, starts).max(axis=0)) + MARGIN).astype(int)
    one, other = (np.ascontiguousarray(image[low[1] : high[1], low[0] : high[0]]) for image in (before, now))
    one, other = alike(one, other)
    first = np.ascontiguousarray(begins - low, np.float32)
    ends, missed, _ = there_and_back(one, other, first, starts - low, ITERATIONS, back_from_begins=True)
    size = np.array(one.shape[::-1])
    good = (missed < FARTHEST_RETURN) & ((ends >= HALF) & (ends < size - HALF)).all(axis=1)
    information = np.empty((len(kept), 3))
    _information(one, first, missed, information)
    return ends[good] + low, information[good], kept[good]


def alike(one: Array, other: Array) -> tuple[Array, Array]:
    """Two grey images (h, w) uint8 at the same exposure, that of the darker: flow takes grey values to stay.

    The median of ratios is that of what does not move.
    """
    a, b = (image[::STEP, ::STEP].astype(np.float32) for image in (one, other))
    bright = (a > DARK) & (b > DARK) & (a < 255.0) & (b < 255.0)
    gain = float(np.median(b[bright] / a[bright])) if bright.any() else 1.0
    if abs(gain - 1.0) <= SAME:
        return one, other
    if gain > 1.0:
        return one, np.asarray(cv2.convertScaleAbs(other, alpha=1.0 / gain))
    return np.asarray(cv2.convertScaleAbs(one, alpha=gain)), other


@njit(cache=True, error_model="numpy", nogil=True)
def _information(image, points, missed, information):
    """information (N, 3) of points (N, 2) px that miss their beginning by `missed` (N,) px."""
    height, width = image.shape
    for n in range(len(points)):
        x0, y0 = int(points[n, 0] + 0.5), int(points[n, 1] + 0.5)
        xx = xy = yy = 0.0
        for y in range(max(y0 - HALF, 1), min(y0 + HALF + 1, height - 1)):
            for x in range(max(x0 - HALF, 1), min(x0 + HALF + 1, width - 1)):
                gx = 0.5 * (np.float64(image[y, x + 1]) - np.float64(image[y, x - 1]))
                gy = 0.5 * (np.float64(image[y + 1, x]) - np.float64(image[y - 1, x]))
                xx += gx * gx
                xy += gx * gy
                yy += gy * gy
        xx, xy, yy = xx / GREY_VARIANCE, xy / GREY_VARIANCE, yy / GREY_VARIANCE
        # (A^-1 + f I)^-1 = A (I + f A)^-1, which needs no inverse of A
        a, c = 1.0 + FLOOR * xx, 1.0 + FLOOR * yy
        b = FLOOR * xy
        trust = 1.0 / ((a * c - b * b) * (1.0 + (missed[n] / RETURN) ** 2))
        information[n, 0] = (xx * c - xy * b) * trust
        information[n, 1] = (xy * a - xx * b) * trust
        information[n, 2] = (yy * a - xy * b) * trust
