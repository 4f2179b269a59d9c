"""Vectors that were felt in a frame of another heading, against those that were seen, at offsets in time."""

from __future__ import annotations

import math

import numpy as np

from panoptic_ros.kernels import njit

Array = np.ndarray


@njit(cache=True, error_model="numpy", nogil=True)
def compare_turned(
    felt: tuple[Array, Array], seen: tuple[Array, Array, Array], offsets: Array
) -> tuple[Array, Array, Array, Array]:
    """Sums of weighed squares of what is left, by the heading: t^T matrix t - 2 vector^T t + constant, where
    t is its cosine and sine.

    Args:
        felt: when (N,), rising, and vectors (N, 3), between which they are linear; NaN = not there.
        seen: when (T,), vectors (T, 3) and their information (T, 3, 3).
        offsets: (O,) of the clock of what was felt, in the unit of the others.

    Returns:
        matrices (O, 2, 2), vectors (O, 2), constants (O,), and how many were compared (O,).
    """
    when, vectors = felt
    stamps, goals, information = seen
    count = len(offsets)
    matrices, pulls = np.zeros((count, 2, 2)), np.zeros((count, 2))
    constants, numbers = np.zeros(count), np.zeros(count, np.int64)
    there, rest, level, weighed = np.empty(3), np.empty(3), np.zeros((3, 2)), np.empty((3, 2))
    for o in range(count):
        k = 0
        for t in range(len(stamps)):
            moment = stamps[t] - offsets[o]
            while k < len(when) - 2 and when[k + 1] <= moment:
                k += 1
            share = min(max((moment - when[k]) / (when[k + 1] - when[k]), 0.0), 1.0)
            for i in range(3):
                there[i] = vectors[k, i] + share * (vectors[k + 1, i] - vectors[k, i])
            if not (math.isfinite(there[0]) and math.isfinite(there[1]) and math.isfinite(there[2])):
                continue
            numbers[o] += 1
            level[0, 0], level[1, 0], level[0, 1], level[1, 1] = there[0], there[1], -there[1], there[0]
            for i in range(3):
                rest[i] = goals[t, i]
            rest[2] -= there[2]
            for i in range(3):
                for j in range(2):
                    weighed[i, j] = information[t, i, 0] * level[0, j] + information[t, i, 1] * level[1, j]
            for j in range(2):
                for m in range(2):
                    matrices[o, j, m] += level[0, j] * weighed[0, m] + level[1, j] * weighed[1, m]
                for i in range(3):
                    pulls[o, j] += weighed[i, j] * rest[i]
            for i in range(3):
                for m in range(3):
                    constants[o] += rest[i] * information[t, i, m] * rest[m]
    return matrices, pulls, constants, numbers
