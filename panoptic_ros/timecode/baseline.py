"""What a fit leaves free of a word's samples: everything slow, such as DC and hum.

Slow functions are given at every few samples and lie on straight lines between them, so that their products
with samples need few operations.
"""
from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

Array = np.ndarray
HIGHEST_HZ = 330.0
KNOT_HZ = 6000.0  # at least: lines follow hum of 50 Hz to 0.03 %


@dataclass(frozen=True, slots=True)
class Baseline:
    """Orthonormal slow functions.

    Args:
        basis: (T, K) at every `step`-th sample.
        step: samples.
    """

    basis: Array
    step: int


def baseline(count: int, sample_rate: int) -> Baseline:
    """Of `count` samples.

    Cosines are level at both ends; hum and what droop leaves are not: a line and a parabola come with them.
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
    triangle = np.linalg.qr(lines.T, mode="r")
    basis = np.linalg.solve(triangle.T, knots)
    basis.flags.writeable = False
    return Baseline(basis, step)
