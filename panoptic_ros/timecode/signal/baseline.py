"""The baseline of a word's samples, which a fit leaves free: everything slow, such as DC and hum.

Its functions are given at every few samples, with straight lines between, so that their products with samples
need few operations.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from panoptic_ros.kernels import njit

Array = np.ndarray
_sum = njit(cache=True, error_model="numpy", nogil=True, fastmath={"reassoc", "contract"})
HIGHEST_HZ = 330.0
KNOT_HZ = 6000.0  # at least: lines follow hum of 50 Hz to 0.03 %


class Baseline(NamedTuple):
    """Orthonormal slow functions.

    Args:
        basis: (T, K) at every `step`-th sample.
        step: samples.
    """

    basis: Array
    step: int


def baseline_of(count: int, sample_rate: int) -> Baseline:
    """The baseline of `count` samples: cosines, a line and a parabola.

    Cosines are level at both ends; hum and the rest of droop are not.
    """
    terms = max(4, int(2.0 * HIGHEST_HZ * count / sample_rate))
    return _baseline(count, terms, max(1, int(sample_rate / KNOT_HZ)))


@lru_cache(maxsize=64)
def _baseline(count: int, terms: int, step: int) -> Baseline:
    at = (step * np.arange((count - 1) // step + 2) + 0.5) / count
    knots = np.vstack([np.cos(np.pi * np.arange(terms)[:, None] * at), at, at * at])
    below, rest = np.divmod(np.arange(count), step)
    after = rest / step
    lines = knots[:, below] * (1.0 - after) + knots[:, below + 1] * after
    triangle = np.asarray(np.linalg.qr(lines.T, mode="r"))
    basis = np.linalg.solve(triangle.T, knots)
    basis.flags.writeable = False
    return Baseline(basis, step)


@_sum
def hat_sums(rows: Array, step: int) -> Array:
    """Products (I, K) of rows (I, N) with triangular hats on every `step`-th sample, 0 at the next ones."""
    count = rows.shape[1]
    sums = np.zeros((len(rows), (count - 1) // step + 2))
    for i in range(len(rows)):
        row, out = rows[i], sums[i]
        for j in range(step):
            after = j / step
            for k in range((count - 1 - j) // step + 1):
                value = row[k * step + j]
                out[k] += (1.0 - after) * value
                out[k + 1] += after * value
    return sums


@_sum
def gram_without(rows: Array, baseline: Baseline) -> tuple[Array, Array]:
    """Products (I, I) of rows (I, N) without their part in a baseline, and that part (I, T).

    Written out, since these are too small for a library that starts threads.
    """
    basis = baseline.basis
    sums = hat_sums(rows, baseline.step)
    slow = np.empty((len(rows), len(basis)))
    gram = np.empty((len(rows), len(rows)))
    for i in range(len(rows)):
        for j in range(len(basis)):
            total = 0.0
            for k in range(basis.shape[1]):
                total += sums[i, k] * basis[j, k]
            slow[i, j] = total
    for i in range(len(rows)):
        for j in range(i, len(rows)):
            total = 0.0
            for k in range(rows.shape[1]):
                total += rows[i, k] * rows[j, k]
            for k in range(slow.shape[1]):
                total -= slow[i, k] * slow[j, k]
            gram[i, j] = gram[j, i] = total
    return gram, slow
