"""All compiled loops of the rooms, called once with the types that they are called with later."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from panoptic_ros.timecode.follow.lines import curve_excess, line_fit
from panoptic_ros.timecode.signal.baseline import Baseline, gram_without, hat_sums
from panoptic_ros.timecode.signal.clicks import ClickLimits, bridge_clicks
from panoptic_ros.timecode.signal.filters import between, high_pass, limit
from panoptic_ros.timecode.signal.grid import Grid, moved_grid
from panoptic_ros.timecode.signal.half_cells import half_levels, tick_levels
from panoptic_ros.timecode.signal.shape_kernels import OWN, corrected, integrated, shape_rows, without_own
from panoptic_ros.timecode.signal.wave import Edges, Samples, edge_places, train_rows
from panoptic_ros.timecode.word.bit_clock import best_grid, drawn_grid
from panoptic_ros.timecode.word.edge_kernels import fit_edges, line_through, waver
from panoptic_ros.timecode.word.fit_kernels import FitLimits, fit_train
from panoptic_ros.timecode.word.search_kernels import scan_lengths, sync_means
from panoptic_ros.timecode.word.smoothing import BANDWIDTHS, Motion, likelihoods, smooth
from panoptic_ros.timecode.word.tracking import track
from panoptic_ros.timecode.word.unseen_kernels import jumps, widest_gap
from panoptic_ros.timecode.word.viterbi import FREE, best_path, match, soft_bits


@lru_cache(maxsize=1)
def compile_kernels() -> None:
    """Compile all kernels, or take them from numba's cache: a stream that runs must not wait for that."""
    _compile_conditioning()
    _compile_words()
    _compile_fit()
    _compile_lines()


def _compile_conditioning() -> None:
    limit(np.ones(400), 100, 0.8, 2.0, 3.0)
    bridge_clicks(np.ones(400), ClickLimits(20, 100, 0.8, 2.0, 5))
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
    edge_places(wanted)
    edge_places(wanted[::-1])
    drawn_grid(sums, grid, signs, 1.0)
    match(halves, wanted, 0.0, 0.0)


def _compile_fit() -> None:
    samples = Samples(0, np.sin(np.arange(400.0)))
    edges = Edges(Grid(200.0, 20.0), np.arange(-4.0, 5.0))
    basis, shape = np.ones((1, 401)) / 20.0, np.ones((2, 3, 4))
    train, splines = np.ones((5, 40)), np.ones((2, 2, 3, 4))
    for constant in (basis, shape, splines):
        constant.flags.writeable = False  # as the real ones: other types for numba
    baseline = Baseline(basis, 1)
    limits = FitLimits(2, 0.1, 0.1, 4.0, 0.2, 1.0, 1.0)
    fit_train(samples, edges, shape, baseline, limits)
    motion, cells = Motion(-4.0, 120.0, 20.0, 0.0, np.full(6, 0.01)), np.arange(-4.0, 5.0)
    fit_edges(samples, cells, 200.0 + 20.0 * cells, shape, baseline, limits, (motion, 0.5, 0))
    smooth(cells, cells, np.ones(9), motion, 0.5)
    likelihoods(cells, cells, np.ones(9), motion, BANDWIDTHS)
    line_through(cells, cells, np.ones(9))
    waver(cells, cells, np.ones(9), 2)
    rows = train_rows(samples, edges, shape)
    gram_without(rows, baseline)
    hat_sums(rows, 1)
    integrated(train[0])
    shape_rows(train, 1.0, 0, Edges(Grid(20.0, 4.0), np.arange(-4.0, 5.0)), splines, 1.0)
    without_own(np.eye(OWN + 2))
    corrected(shape, splines, np.ones(2))


def _compile_lines() -> None:
    words = np.arange(28.0).reshape(4, 7)
    line_fit(words)
    curve_excess(words, 1.0)
    jumps(np.ones(7), 1.0)
    widest_gap(np.ones(7), 1.0)
