"""Predict where words begin on a tape whose speed changes within words: wow, flutter, ramps.

The next word is tracked edge by edge, starting at the sync word before it. Therefore its speed need not be
predicted.
"""

from __future__ import annotations

import numpy as np

from panoptic_ros.timecode.signal.half_cells import CellGrid
from panoptic_ros.timecode.signal.stream import Stream
from panoptic_ros.timecode.word.layout import WORD_CELLS
from panoptic_ros.timecode.word.tracking import BEFORE, TICKS, track

Array = np.ndarray
HALF = 0.5 * WORD_CELLS
ABOUT_CELLS = 8  # number of cells over which the cell length is measured


class Wander:
    """Motion of one signal at changing speed.

    Args:
        reverse: True if the tape runs backwards.
        place, cell: start position for tracking the next word and the cell length there, recorded samples.
        ticks: (193,) recorded samples of the next word if it is already tracked. The first word of a signal
            needs this, as there is nothing before it to track from.

    Attributes:
        level: level of the conditioned signal.
    """

    def __init__(self, reverse: bool, place: float, cell: float, ticks: Array | None = None):
        self.reverse = reverse
        self.level = 0.0
        self._place, self._cell, self._tracked = place, cell, ticks

    @classmethod
    def about(cls, reverse: bool, grid: CellGrid, stream: Stream, level: float) -> Wander:
        """Create the motion from the signal level and the grid (recorded samples) of the next word."""
        middle = stream.in_sums(grid)
        count = TICKS // 2 + (0 if reverse else BEFORE)
        back = stream.ticks_in_recorded(track(stream.sums, middle.middle, -middle.cell, count, level))
        cell = 2.0 * float(back[-1 - ABOUT_CELLS] - back[-1]) / ABOUT_CELLS
        wander = cls(reverse, float(back[-1]), cell)
        wander.level = level
        return wander

    @property
    def grid(self) -> CellGrid:
        """Return the approximate grid of the next word."""
        before = 0.0 if self.reverse else 0.5 * BEFORE
        return CellGrid(self._place + (HALF + before) * self._cell, self._cell)

    def listen(self, stream: Stream) -> Array:
        """Return the ticks (193,) of the next word and of the sync word before it, on the running sum."""
        if self._tracked is not None:
            return stream.ticks_in_sums(self._tracked)
        place, cell = stream.in_sums(CellGrid(self._place, self._cell))
        return track(stream.sums, place, cell, TICKS + BEFORE, self.level)

    def own(self, ticks: Array) -> Array:
        """Return the ticks (161,) of the word without its sync word before."""
        return ticks[: TICKS + 1] if self.reverse else ticks[BEFORE:]

    def skip(self, ticks: Array) -> None:
        """Advance to the next word.

        Args:
            ticks: (193,) recorded samples of the word that was read.
        """
        at = slice(TICKS - ABOUT_CELLS, TICKS + (0 if self.reverse else ABOUT_CELLS) + 1)
        some = ticks[at]
        self._cell = 2.0 * float(some[-1] - some[0]) / (len(some) - 1)
        self._place, self._tracked = float(ticks[TICKS]), None
