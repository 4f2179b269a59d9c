"""Track the half cells of a signal edge by edge, forwards or backwards, through speed changes.

The tracker is a phase-locked loop. The last tick and the half-cell length predict the next tick. An edge near
the predicted tick corrects it. The gains are those of a Kalman filter with constant noise. No bits are
decided.
"""

from __future__ import annotations

import numpy as np

from panoptic_ros.kernels import njit
from panoptic_ros.timecode.signal.half_cells import integral
from panoptic_ros.timecode.word.layout import SYNC, WORD_CELLS

Array = np.ndarray
_jit = njit(cache=True, error_model="numpy", nogil=True)
BANDWIDTH = 0.25  # radians per cell, loop bandwidth: above any flutter, below the noise
EDGES = 0.7  # mean number of edges per tick
PULL, TURN = 2.0**0.5 * BANDWIDTH * 0.5 / EDGES, 0.25 * BANDWIDTH**2 / EDGES
OPPOSED = 1.3  # minimum ratio of the difference to the sum of the levels on the two sides of an edge
FARTHEST = 0.15  # cells, limit to which the distance of an edge from its tick is clipped
BEFORE = 2 * len(SYNC)  # ticks of the sync word sent before a word
TICKS = 2 * WORD_CELLS
# cells, positions of the ticks of a word relative to the middle of the word
BETWEEN = np.arange(-WORD_CELLS, WORD_CELLS + 1) * 0.5


@_jit
def track(sums: Array, place: float, cell: float, count: int, level: float) -> Array:
    """Track half cells from a given edge; return their ticks (count + 1,).

    Args:
        sums: running sum of the conditioned signal.
        place: (samples) approximate position of an edge.
        cell: (samples) cell length at that edge; negative to track backwards.
        level: level of the signal. The ticks do not follow the noise in silence, where levels are lower.
    """
    ticks = np.empty(count + 1)
    half = 0.5 * cell
    most = FARTHEST * abs(cell)
    for k in range(count + 1):
        reach, near = abs(0.5 * half), abs(0.25 * half)
        here = integral(sums, place)
        before = here - integral(sums, place - reach)
        after = integral(sums, place + reach) - here
        turn = after - before
        opposed = abs(turn) > OPPOSED * abs(after + before)
        # If plateaus droop, an edge is where the level after is higher than before.
        if opposed or (abs(after) > abs(before) and abs(turn) > level * reach):
            inner = integral(sums, place + near) - integral(sums, place - near)
            later = integral(sums, place + reach + near) - integral(sums, place - reach - near) - 3.0 * inner
            size = max(abs(turn), level * reach)
            away = 0.5 * reach * (later if turn > 0.0 else -later) / size
            away = min(max(away, -most), most)
            place += PULL * away
            half += TURN * away
        ticks[k] = place
        place += half
    return ticks


def word_ticks(ticks: Array, begin: int, reverse: bool) -> Array | None:
    """Return the ticks (`BEFORE` + `TICKS` + 1,) of a word and of the sync word sent before it.

    Missing ticks of the sync word are extrapolated evenly.

    Args:
        ticks: (N,) tracked ticks.
        begin: index of the tick at which the word begins in the stream.

    Returns: the ticks, or None if part of the word itself is missing.
    """
    if begin < 0 or begin + TICKS >= len(ticks):
        return None
    first, last = (begin, begin + TICKS + BEFORE) if reverse else (begin - BEFORE, begin + TICKS)
    head = ticks[0] - (ticks[1] - ticks[0]) * np.arange(max(0, -first), 0, -1)
    tail = ticks[-1] + (ticks[-1] - ticks[-2]) * np.arange(1, max(0, last + 1 - len(ticks)) + 1)
    return np.concatenate([head, ticks[max(0, first) : last + 1], tail])
