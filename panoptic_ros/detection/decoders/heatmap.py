"""Decoder of one score map per joint, for one person: HRNet, SimpleBaseline, ViTPose.

A joint is the cell with the largest value, refined in one of two ways. Mode "quarter" moves a quarter of a
cell towards the larger neighbour (Newell et al. 2016, as in HRNet). Mode "dark" is a Newton step on the
logarithm of the blurred map (DARK, Zhang et al. 2020), which is exact for a Gaussian.
"""

from __future__ import annotations

import cv2
import numpy as np

Array = np.ndarray
BLUR = 11  # cells, side of the Gaussian kernel that DARK blurs with
FLOOR = 1e-3  # lower values are noise; this floor keeps the logarithm finite


def decode_heatmap(heat: Array, refine: str) -> tuple[Array, Array]:
    """Decode joints (K, 2) in cells (column, row) and scores (K,) from maps (K, h, w).

    Args:
        refine: "quarter" or "dark".
    """
    count, _, columns = heat.shape
    flat = heat.reshape(count, -1)
    best = flat.argmax(axis=1)
    cells = np.stack(np.divmod(best, columns), axis=1)[:, ::-1]
    step = _quarter_step if refine == "quarter" else _newton_step
    moved = cells + np.array([step(plane, x, y) for plane, (x, y) in zip(heat, cells)])
    return moved, np.clip(flat[np.arange(count), best], 0.0, 1.0).astype(float)


def _quarter_step(plane: Array, x: int, y: int) -> Array:
    step = np.zeros(2)
    if 0 < x < plane.shape[1] - 1:
        step[0] = 0.25 * np.sign(plane[y, x + 1] - plane[y, x - 1])
    if 0 < y < plane.shape[0] - 1:
        step[1] = 0.25 * np.sign(plane[y + 1, x] - plane[y - 1, x])
    return step


def _newton_step(plane: Array, x: int, y: int) -> Array:
    """Return the step from the peak to the maximum of a local quadratic fit, at most one cell per axis."""
    if not (0 < x < plane.shape[1] - 1 and 0 < y < plane.shape[0] - 1):
        return np.zeros(2)
    smooth = cv2.GaussianBlur(plane.astype(np.float32), (BLUR, BLUR), 0)
    around = np.log(np.maximum(smooth[y - 1 : y + 2, x - 1 : x + 2].astype(float), FLOOR))
    gradient = 0.5 * np.array([around[1, 2] - around[1, 0], around[2, 1] - around[0, 1]])
    dxx = around[1, 2] - 2.0 * around[1, 1] + around[1, 0]
    dyy = around[2, 1] - 2.0 * around[1, 1] + around[0, 1]
    dxy = 0.25 * (around[2, 2] - around[2, 0] - around[0, 2] + around[0, 0])
    if dxx * dyy - dxy**2 <= 0.0 or dxx >= 0.0:  # the fit has no maximum
        return np.zeros(2)
    step = -np.linalg.solve(np.array([[dxx, dxy], [dxy, dyy]]), gradient)
    return np.clip(step, -1.0, 1.0)
