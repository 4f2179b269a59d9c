"""Exact depth maps made like those of a time-of-flight sensor."""

from __future__ import annotations

import numpy as np

Array = np.ndarray
SIGMA, AT = 0.0015, 2.0  # m, at so many m; it grows with the square of depth (Khoshelham and Elberink 2012)
STEP = 0.001  # m
HOLES = 0.02  # share of pixels that are unknown
EDGE = 0.05  # m between neighbours
MIXED, LOST = 0.3, 0.5  # shares of the pixels at edges that mix both surfaces, and that are unknown


def kinect_like(depth: Array, rng: np.random.Generator) -> Array:
    """A map (h, w) float32 m with noise, steps, holes, and mixed and lost pixels at edges; 0 = unknown."""
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
