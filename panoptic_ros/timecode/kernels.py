"""All compiled loops of the rooms, called once with the types that they are called with later."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from panoptic_ros.timecode.signal.clicks import ClickLimits, bridge_clicks
from panoptic_ros.timecode.signal.conditioning import between, hat_sums, high_pass, limit
from panoptic_ros.timecode.signal.half_cells import Grid, half_levels, moved_grid, tick_levels
from panoptic_ros.timecode.word.edges import EVEN, fit_edges
from panoptic_ros.timecode.word.layout import FREE
from panoptic_ros.timecode.word.search import best_grid, scan_lengths, sync_means
from panoptic_ros.timecode.word.tracking import track
from panoptic_ros.timecode.word.viterbi import best_path, match, soft_bits


@lru_cache(maxsize=1)
def compile_kernels() -> None:
    """Compile all kernels, or take them from numba's cache: a stream that runs must not wait for that."""
    _compile_conditioning()
    _compile_words()


def _compile_conditioning() -> None:
    limit(np.ones(400), 100, 0.8, 2.0, 3.0)
    bridge_clicks(np.ones(400), ClickLimits(20, 100, 0.8, 2.0, 5))
    hat_sums(np.ones((1, 400)), 1)
    high_pass(np.ones(400), np.ones(400), np.ones(5), 1)
    between(np.ones(400), np.ones((1, 4)))


def _compile_words() -> None:
    sums, grid, few = np.cumsum(np.ones(400)), Grid(200.0, 20.0), np.zeros(1)
    halves, wanted = np.ones(16), np.full(8, FREE, np.int8)
    half_levels(sums, grid, -4.0, 8)
    tick_levels(sums, track(sums, 20.0, 8.0, 10, 1.0))
    best_grid(sums, grid, -4.0, 8, few, few)
    scan_lengths(sums, 0.0, 200.0, np.array([10.0]), 2)
    signs = best_path(halves, wanted, 0.0).signs
    soft_bits(halves, wanted, 0.0)
    sync_means(wanted, wanted[:4], 4)
    moved_grid(grid, 1.0)
    fit_edges(sums, grid.middle + np.arange(-80.0, 81.0), np.repeat(signs, 10), 1.0, EVEN)
    match(halves, wanted, 0.0, 0.0)
