"""Depth maps with the errors of a time-of-flight sensor, made from exact ones."""

from __future__ import annotations

import numpy as np

Array = np.ndarray
# SIGMA: depth noise (m) at depth AT (m); it grows with the square of depth (Khoshelham and Elberink 2012)
SIGMA, AT = 0.0015, 2.0
STEP = 0.001  # m; depth quantisation
HOLES = 0.02  # share of pixels without a value
EDGE = 0.05  # m; depth range within 3 x 3 pixels above which a pixel is at an edge
MIXED, LOST = 0.3, 0.5  # shares of edge pixels that mix both surfaces, and that have no value


def kinect_like(depth: Array, rng: np.random.Generator) -> Array:
    """Return a depth map (h, w) float32 m with sensor errors, 0 = no value.

    The errors are noise, quantisation, holes, and mixed and lost pixels at edges.
    """
    height, width = depth.shape
    padded = np.pad(depth.astype(np.float64), 1, mode="edge")
    around = np.stack([padded[i : i + height, k : k + width] for i in range(3) for k in range(3)])
    edge = around.max(axis=0) - around.min(axis=0) > EDGE
    rows, columns = np.indices(depth.shape)
    other = around[rng.integers(0, 9, depth.shape), rows, columns]
    share = np.where(edge & (rng.random(depth.shape) < MIXED), rng.random(depth.shape), 0.0)
    mixed = depth + share * (other - depth)
    noisy = mixed + SIGMA * (mixed / AT) ** 2 * rng.standard_normal(depth.shape)
    lost = (rng.random(depth.shape) < HOLES) | (edge & (rng.random(depth.shape) < LOST))
    lost |= (depth <= 0.0) | (other <= 0.0)
    found: Array = np.where(lost, 0.0, np.maximum(STEP * np.round(noisy / STEP), 0.0)).astype(np.float32)
    return found
