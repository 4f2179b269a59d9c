"""The loops of the search for a signal."""

from __future__ import annotations

import numpy as np

from panoptic_ros.kernels import njit
from panoptic_ros.timecode.signal.half_cells import energy

Array = np.ndarray
_jit = njit(cache=True, error_model="numpy", nogil=True)


@_jit
def scan_lengths(sums: Array, begin: float, span: float, halves: Array, phases: int) -> Array:
    """For each length of a half cell the largest mean square level over the phases, and that edge, (H, 2)."""
    rows = np.empty((len(halves), 2))
    for i, half in enumerate(halves):
        count = int(span / half) - 1
        rows[i, 0] = -1.0
        for phase in range(phases):
            start = begin + half * phase / phases
            total = energy(sums, start, half, count) / (half * half * count)
            if total > rows[i, 0]:
                rows[i, 0], rows[i, 1] = total, start
    return rows


@_jit
def sync_means(bits: Array, pattern: Array, word: int) -> Array:
    """Mean number of bits (word,) that agree with a pattern (M,) from each place of the words on."""
    totals, words = np.zeros(word), np.zeros(word)
    for i in range(len(bits) - len(pattern) + 1):
        agreeing = 0
        for j in range(len(pattern)):
            agreeing += bits[i + j] == pattern[j]
        totals[i % word] += agreeing
        words[i % word] += 1.0
    return totals / np.maximum(words, 1.0)
