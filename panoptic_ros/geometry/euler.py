"""Euler angles of a joint about three axes."""

from __future__ import annotations

import numpy as np

Array = np.ndarray
ORDERS = ("xyz", "xzy", "yxz", "yzx", "zxy", "zyx")
TURNED = 1e-9  # largest 1 - |sine| at which the middle angle is treated as a right angle


def euler_angles(rotations: Array, order: str) -> Array:
    """Return angles (..., 3) rad of intrinsic rotations about the axes of `order`.

    The rotation is R_a(angle 0) R_b(angle 1) R_c(angle 2) for order "abc". This is like three hinges in a row
    (ISB's joint coordinate systems, Wu et al. 2005). The middle angle is within a right angle. At a right
    angle only the sum or difference of the other two is determined, and the last one is 0.
    """
    a, b, c = ("xyz".index(axis) for axis in order)
    sign = 1.0 if (b - a) % 3 == 1 else -1.0
    sine = np.clip(sign * rotations[..., a, c], -1.0, 1.0)
    locked = 1.0 - np.abs(sine) < TURNED
    first = np.arctan2(-sign * rotations[..., b, c], rotations[..., c, c])
    last = np.arctan2(-sign * rotations[..., a, b], rotations[..., a, a])
    alone = np.arctan2(sign * rotations[..., c, b], rotations[..., b, b])
    return np.stack([np.where(locked, alone, first), np.arcsin(sine), np.where(locked, 0.0, last)], axis=-1)
