"""Where words begin on a tape whose speed changes within them: wow, flutter, ramps.

The next word is tracked edge by edge, from the sync word before it on, so nothing has to be foreseen of its
speed.
"""

from __future__ import annotations

import numpy as np

from panoptic_ros.timecode.signal.half_cells import Grid
from panoptic_ros.timecode.signal.stream import Stream
from panoptic_ros.timecode.word.layout import WORD_CELLS
from panoptic_ros.timecode.word.tracking import BEFORE, TICKS, track

Array = np.ndarray
HALF = 0.5 * WORD_CELLS
ABOUT_CELLS = 8  # over which the length of a cell is measured


class Wander:
    """The motion of one signal.

    Args:
        reverse: whether the tape runs backwards.
        place, cell: samples, where to listen for the next word from, and the length of a cell there.
        ticks: (193,) recorded samples, of the next word if it was tracked already; before the first word of
            a signal there is nothing to follow.

    Attributes:
        level: of the conditioned signal.
    """

    def __init__(self, reverse: bool, place: float, cell: float, ticks: Array | None = None):
        self.reverse = reverse
        self.level = 0.0
        self._place, self._cell, self._tracked = place, cell, ticks

    @classmethod
    def about(cls, reverse: bool, grid: Grid, stream: Stream, level: float) -> Wander:
        """From a guess of the middle of the next word, recorded samples, and the level of the signal."""
        middle = stream.in_sums(grid)
        count = TICKS // 2 + (0 if reverse else BEFORE)
        back = stream.ticks_in_recorded(track(stream.sums, middle.middle, -middle.cell, count, level))
        cell = 2.0 * float(back[-1 - ABOUT_CELLS] - back[-1]) / ABOUT_CELLS
        wander = cls(reverse, float(back[-1]), cell)
        wander.level = level
        return wander

    @property
    def grid(self) -> Grid:
        """About where the next word is."""
        before = 0.0 if self.reverse else 0.5 * BEFORE
        return Grid(self._place + (HALF + before) * self._cell, self._cell)

    def listen(self, stream: Stream) -> Array:
        """Ticks (193,) of the next word and the sync word before it, on the running sum."""
        if self._tracked is not None:
            return stream.ticks_in_sums(self._tracked)
        place, cell = stream.in_sums(Grid(self._place, self._cell))
        return track(stream.sums, place, cell, TICKS + BEFORE, self.level)

    def own(self, ticks: Array) -> Array:
        """Those (161,) of the word alone."""
        return ticks[: TICKS + 1] if self.reverse else ticks[BEFORE:]

    def skip(self, ticks: Array) -> None:
        """Go on to the next word.

        Args:
            ticks: (193,) recorded samples, of the last one.
        """
        at = slice(TICKS - ABOUT_CELLS, TICKS + (0 if self.reverse else ABOUT_CELLS) + 1)
        some = ticks[at]
        self._cell = 2.0 * float(some[-1] - some[0]) / (len(some) - 1)
        self._place, self._tracked = float(ticks[TICKS]), None
