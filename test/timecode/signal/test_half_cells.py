"""Integrals over half cells against plain numpy, and the bits of a clean signal."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from panoptic_ros.domain import Timecode
from panoptic_ros.simulation.ltc_signal import (
    encode_ltc,
    timecode_rate,
    word_bits,
)
from panoptic_ros.timecode.signal.half_cells import CellGrid, half_levels, integral, moved_grid, place_of
from panoptic_ros.timecode.word.layout import FREE
from panoptic_ros.timecode.word.viterbi import best_path

Array = np.ndarray


def integrate(sums: Array, positions: Array) -> Array:
    """Integral from the first sample to fractional positions, in plain numpy."""
    place = np.clip(positions + 0.5, 0.0, len(sums) - 1.001)
    below = place.astype(np.int64)
    part = place - below
    return sums[below] * (1.0 - part) + sums[below + 1] * part


def half_cells(sums: Array, start: float, cell: float, count: int) -> Array:
    """Mean level (2 * count,) of the half cells of `count` cells from `start` on, in plain numpy."""
    bounds = start + 0.5 * cell * np.arange(2 * count + 1)
    return np.diff(integrate(sums, bounds)) / (0.5 * cell)


@settings(max_examples=50, deadline=None)
@given(st.lists(st.floats(-1.0, 1.0), min_size=8, max_size=8), st.lists(st.floats(-0.4, 8.4), min_size=1))
def test_integrals_are_those_of_the_staircase(values: list[float], ends: list[float]) -> None:
    sums = np.concatenate([[0.0], np.cumsum(values)])
    fine = np.repeat(values, 1000)  # sample i covers i - 0.5 to i + 0.5
    for end in ends:
        expected = fine[: max(0, round((end + 0.5) * 1000))].sum() / 1000
        assert integrate(sums, np.array(end)) == pytest.approx(expected, abs=0.01)
        assert integral(sums, end) == pytest.approx(float(integrate(sums, np.array(end))), abs=1e-9)


def test_cells_of_a_clean_signal() -> None:
    signal = encode_ltc(Timecode.from_frame_count(777, timecode_rate("30")), 2, 48000, lead=50.5)
    sums = np.concatenate([[0.0], np.cumsum(signal.samples.astype(float))])
    halves = half_cells(sums, 50.5, 20.0, 160)
    score, bits, _ = best_path(halves, np.full(160, FREE, np.int8), 0.0)
    assert bits.tolist() == [bit for label in signal.labels for bit in word_bits(label)]
    assert score > 0.999 * np.abs(halves).sum()
    np.testing.assert_allclose(half_levels(sums, CellGrid(50.5, 20.0), 0.0, 160), halves, atol=1e-12)


def test_a_grid_is_moved_by_whole_cells() -> None:
    grid = CellGrid(1000.0, 20.0)
    moved = moved_grid(grid, 7.0)
    for u in (-3.0, 0.0, 5.0):
        assert place_of(moved, u) == pytest.approx(grid.middle + grid.cell * (7.0 + u))
