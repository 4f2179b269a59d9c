"""Torso frame: forward, left and up, from shoulders and hips."""

from __future__ import annotations

import numpy as np

Array = np.ndarray

SHORTEST = 0.05  # m, a shorter or narrower torso has no frame


def torso_frames(corners: Array) -> tuple[Array, Array]:
    """Return the axes and lengths of torsos.

    Up points from the middle of the hips to that of the shoulders. Left is the mean direction from the right
    to the left side, at right angles to up. Forward is their cross product.

    Args:
        corners: (..., 4, 3) m, left shoulder, right shoulder, left hip, right hip; NaN = missing.

    Returns:
        axes (..., 3, 3), columns forward, left, up, and lengths (...) m from hips to shoulders. Both are NaN
            where a corner is missing or the torso is shorter or narrower than `SHORTEST`.
    """
    shoulders, hips = corners[..., :2, :].mean(axis=-2), corners[..., 2:, :].mean(axis=-2)
    up = shoulders - hips
    length = np.linalg.norm(up, axis=-1)
    across = corners[..., 0, :] - corners[..., 1, :] + corners[..., 2, :] - corners[..., 3, :]
    with np.errstate(invalid="ignore", divide="ignore"):
        up = up / np.where(length >= SHORTEST, length, np.nan)[..., None]
        left = across - (across * up).sum(axis=-1, keepdims=True) * up
        width = np.linalg.norm(left, axis=-1)
        left = left / np.where(width >= SHORTEST, width, np.nan)[..., None]
    axes = np.stack([np.cross(left, up), left, up], axis=-1)
    known = np.isfinite(axes).all(axis=(-2, -1))
    return np.where(known[..., None, None], axes, np.nan), np.where(known, length, np.nan)
