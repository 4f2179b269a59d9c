"""The place of the sync word and of cells in a stretch of bits."""

from __future__ import annotations

import numpy as np

from panoptic_ros.domain import Timecode
from panoptic_ros.simulation.ltc_signal import (
    encode_ltc,
    timecode_rate,
    word_bits,
)
from panoptic_ros.timecode.signal.half_cells import CellGrid, half_levels
from panoptic_ros.timecode.word.acquisition import _even_parity
from panoptic_ros.timecode.word.layout import SYNC, SYNC_BACK
from panoptic_ros.timecode.word.search import sync_means


def test_sync_is_found_in_both_directions_and_nowhere_else() -> None:
    bits = np.array(word_bits(Timecode(23, 59, 59, 29, timecode_rate("30")), 0xFFFFFFFF), np.int8)
    stream = np.tile(bits, 3)
    assert list(np.flatnonzero(sync_means(stream, SYNC, 80) == 16)) == [64]
    assert list(np.flatnonzero(sync_means(stream[::-1].copy(), SYNC_BACK, 80) == 16)) == [0]
    assert not (sync_means(stream, SYNC_BACK, 80) == 16).any()


def test_cells_begin_where_the_level_always_changes() -> None:
    signal = encode_ltc(Timecode.from_frame_count(777, timecode_rate("30")), 2, 48000, lead=50.5)
    sums = np.concatenate([[0.0], np.cumsum(signal.samples.astype(float))])
    halves = half_levels(sums, CellGrid(50.5, 20.0), 0.0, 160)
    assert _even_parity(halves) and not _even_parity(halves[1:-1])
