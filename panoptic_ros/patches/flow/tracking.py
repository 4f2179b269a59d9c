"""Tracking of points from one image to the next, with the forward-backward check of `geometry.optical_flow`.

Every point has the inverse covariance of its end. It is the structure tensor of the point's window over the
noise of grey values (Foerstner and Guelch 1987), with a lower limit of the variance. It is reduced for points
with a large forward-backward error (Kalal et al. 2010). A point on an edge has information across the edge
only.
"""

from __future__ import annotations

import cv2
import numpy as np

from panoptic_ros.geometry.optical_flow import HALF, there_and_back
from panoptic_ros.kernels import njit

Array = np.ndarray
ITERATIONS = 10  # optical-flow iterations per pyramid level
RETURN = 0.5  # px, forward-backward error that halves the information of a point
FARTHEST_RETURN = 2.0  # px, forward-backward error from which a point is lost
GREY_VARIANCE = 64.0  # grey-value noise between images, enlarged for correlation within a window
FLOOR = 0.15**2  # px^2, least variance of an end
MARGIN = 48  # px round the points, size of the image part that is used
STEP, DARK = 8, 16  # px between the pixels that measure exposure; grey value above which they count
SAME = 0.02  # relative change of exposure between two images up to which they stay unchanged


def ready() -> None:
    """Compile the kernels, or load them from the cache."""
    _information(
        np.zeros((16, 16), np.uint8),
        np.full((1, 2), 8, np.float32),
        np.zeros(1, np.float32),
        np.empty((1, 3)),
    )


def followed(before: Array, now: Array, begins: Array, starts: Array) -> tuple[Array, Array, Array]:
    """Track points (N, 2) px of a grey image (h, w) uint8 into the next one.

    Args:
        begins: (N, 2) px in the first image.
        starts: (N, 2) px, initial guess in the next image.

    Returns:
        ends (M, 2) px, information (M, 3) px^-2 (xx, xy, yy), and indices (M,) of the points that were found.
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
    """Return two grey images (h, w) uint8 at the exposure of the darker one.

    Optical flow assumes constant grey values. The exposure ratio is the median over the pixels, which is that
    of the static background.
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
    """Compute the information (N, 3) px^-2 of points (N, 2) px.

    Args:
        missed: (N,) px, forward-backward errors.
        information: (N, 3) output: xx, xy, yy.
    """
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
