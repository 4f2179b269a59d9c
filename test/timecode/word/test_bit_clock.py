"""Grids of cells move, and are drawn to the edges of a signal."""

from __future__ import annotations

import numpy as np
import pytest

from panoptic_ros.domain import Timecode
from panoptic_ros.simulation.ltc_signal import (
    encode_ltc,
    timecode_rate,
    word_bits,
)
from panoptic_ros.timecode.signal.grid import Grid, moved_grid, place_of
from panoptic_ros.timecode.signal.half_cells import half_levels
from panoptic_ros.timecode.word.bit_clock import drawn_grid
from panoptic_ros.timecode.word.viterbi import FREE, best_path


def test_grids_move_and_are_drawn_to_the_edges() -> None:
    grid = Grid(1000.0, 20.0)
    moved = moved_grid(grid, 7.0)
    for u in (-3.0, 0.0, 5.0):
        expected = grid[0] + grid[1] * (7.0 + u)
        assert place_of(moved, u) == pytest.approx(expected)
    signal = encode_ltc(Timecode.from_frame_count(777, timecode_rate("30")), 1, 48000, lead=50.5, tail=50)
    sums = np.concatenate([[0.0], np.cumsum(signal.samples.astype(float))])
    guess = Grid(851.8, 20.03)
    _, bits, signs = best_path(half_levels(sums, guess, -40.0, 80), np.full(80, FREE, np.int8), 0.0)
    assert bits.tolist() == word_bits(signal.labels[0])
    drawn = drawn_grid(sums, guess, signs, 0.25)
    for value, expected, tolerance in zip(drawn, [850.5, 20.0], [0.05, 0.002]):
        assert value == pytest.approx(expected, abs=tolerance)
