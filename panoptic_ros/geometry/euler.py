"""Angles of a joint about three axes, one after another."""

from __future__ import annotations

import numpy as np

Array = np.ndarray
ORDERS = ("xyz", "xzy", "yxz", "yzx", "zxy", "zyx")
TURNED = 1e-9  # sine from which the middle angle counts as a right one


def euler_angles(rotations: Array, order: str) -> Array:
    """Angles (..., 3) rad about the axes of `order`, each about the axis as the turns before have left it.

    R = R_a(angle 0) R_b(angle 1) R_c(angle 2) for order "abc", as three hinges in a row would do it (ISB's
    joint coordinate systems, Wu et al. 2005). The middle angle is within a right angle; where it is one,
    only the sum or difference of the others is determined, and the last is 0.
    """
    a, b, c = ("xyz".index(axis) for axis in order)
    sign = 1.0 if (b - a) % 3 == 1 else -1.0
    sine = np.clip(sign * rotations[..., a, c], -1.0, 1.0)
    locked = 1.0 - np.abs(sine) < TURNED
    first = np.arctan2(-sign * rotations[..., b, c], rotations[..., c, c])
    last = np.arctan2(-sign * rotations[..., a, b], rotations[..., a, a])
    alone = np.arctan2(sign * rotations[..., c, b], rotations[..., b, b])
    return np.stack([np.where(locked, alone, first), np.arcsin(sine), np.where(locked, 0.0, last)], axis=-1)
