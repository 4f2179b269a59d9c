"""Where words begin on a tape whose speed changes within them: wow, flutter, ramps.

The next word is tracked edge by edge, from the sync word before it on, so nothing has to be foreseen of its
speed. Then its edges are measured one by one and smoothed, with those of the word before as a beginning. The
bandwidth of the smoother is the one under which the innovations of the last words are most likely.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from panoptic_ros.timecode.signal.grid import Grid
from panoptic_ros.timecode.signal.stream import Stream
from panoptic_ros.timecode.word.fit import Before, FreeEdges, WordFit
from panoptic_ros.timecode.word.layout import WORD_CELLS
from panoptic_ros.timecode.word.smoothing import BANDWIDTHS, Motion, likelihoods, smooth
from panoptic_ros.timecode.word.tracking import BEFORE, TICKS, track

Array = np.ndarray
HALF = 0.5 * WORD_CELLS
FIRST_BANDWIDTH = 7  # of those that are tried
KEEP = 0.85  # of the evidence for bandwidths, from word to word
SCALES = 15  # words, of which the middle scale of the noise counts
ABOUT_CELLS = 8  # over which the length of a cell is measured
UNKNOWN_PLACE, UNKNOWN_SPEED, UNKNOWN_TURN = 0.25, 0.03, 0.002  # cells, by which tracking may be off
OTHERS = 4  # edges of the word before, beside the first of the next
BETWEEN = np.arange(-TICKS // 2, TICKS // 2 + 1) * 0.5  # ticks of a word, in cells from its middle


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
        self._nats = np.zeros(len(BANDWIDTHS))
        self._scales: deque[float] = deque(maxlen=SCALES)
        self._known: tuple[int, Motion, FreeEdges] | None = None  # the next word, its begin, the last word

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

    def again_at(self, other: Wander) -> Wander:
        """From the place of another on, with what was learnt."""
        wander = Wander(self.reverse, other._place, other._cell, other._tracked)
        wander.level = self.level
        wander._nats, wander._scales = self._nats.copy(), self._scales.copy()
        return wander

    @property
    def grid(self) -> Grid:
        """About where the next word is."""
        return Grid(self._place + (HALF + _cells_before(self.reverse)) * self._cell, self._cell)

    @property
    def bandwidth(self) -> float:
        """The most likely one, radians per cell."""
        if not self._nats.any():
            return float(BANDWIDTHS[FIRST_BANDWIDTH])
        return float(BANDWIDTHS[int(np.argmax(self._nats))])

    def listen(self, stream: Stream) -> Array:
        """Ticks (193,) of the next word and the sync word before it, on the running sum."""
        if self._tracked is not None:
            return stream.ticks_in_sums(self._tracked)
        place, cell = stream.in_sums(Grid(self._place, self._cell))
        return track(stream.sums, place, cell, TICKS + BEFORE, self.level)

    def own(self, ticks: Array) -> Array:
        """Those (161,) of the word alone."""
        return ticks[: TICKS + 1] if self.reverse else ticks[BEFORE:]

    def before(self, number: int, ticks: Array) -> Before:
        """What is known before a word.

        Args:
            ticks: (193,) recorded samples, see `listen`.
        """
        if self._known is not None and self._known[0] == number:
            _, motion, edges = self._known
            last = slice(-1 - OTHERS, -1)
            return Before(motion, self.bandwidth, edges.cells[last] - WORD_CELLS, edges.places[last])
        own = self.own(ticks)
        cell = float(own[-1] - own[0]) / WORD_CELLS
        spread = np.array([UNKNOWN_PLACE**2, 0.0, 0.0, UNKNOWN_SPEED**2, 0.0, UNKNOWN_TURN**2]) * cell**2
        motion = Motion(-HALF, float(own[0]), cell, 0.0, spread)
        return Before(motion, self.bandwidth, np.empty(0), np.empty(0))

    def take(self, number: int, fit: WordFit, ticks: Array) -> tuple[float, float]:
        """A good word was fitted: the first edge of its bit 0 and its variance."""
        free = fit.free
        assert free is not None
        nats = likelihoods(free.cells, free.measured, free.noise, free.before, BANDWIDTHS)
        self._nats = KEEP * self._nats + nats
        smoothed = smooth(free.cells, free.measured, free.noise, free.before, self.bandwidth)
        self._scales.append(smoothed.scale)
        end = smoothed.end._replace(cell=-HALF)
        self._known = number + 1, end, free
        own = self.own(ticks)
        own[:] = np.interp(BETWEEN, free.cells, smoothed.places)
        self.skip(ticks)
        bit_0 = -1 if self.reverse else 0
        scale = sorted(self._scales)[len(self._scales) // 2]
        if fit.clicked:
            scale = max(scale, smoothed.scale)
        return float(smoothed.places[bit_0]), scale * float(smoothed.variances[bit_0]) + fit.unseen**2

    def passed(self, fit: WordFit, ticks: Array) -> tuple[float, float]:
        """The same for a word that clicks may have shifted: nothing is learnt from it."""
        free = fit.free
        assert free is not None
        smoothed = smooth(free.cells, free.measured, free.noise, free.before, self.bandwidth)
        self.skip(ticks)
        bit_0 = -1 if self.reverse else 0
        scale = max(1.0, smoothed.scale, *self._scales)
        return float(smoothed.places[bit_0]), scale * float(smoothed.variances[bit_0]) + fit.unseen**2

    def skip(self, ticks: Array) -> None:
        """Go on to the next word.

        Args:
            ticks: (193,) recorded samples, of the last one.
        """
        at = slice(TICKS - ABOUT_CELLS, TICKS + (0 if self.reverse else ABOUT_CELLS) + 1)
        some = ticks[at]
        self._cell = 2.0 * float(some[-1] - some[0]) / (len(some) - 1)
        self._place, self._tracked = float(ticks[TICKS]), None


def _cells_before(reverse: bool) -> float:
    """Cells before a word from which on it is listened to."""
    return 0.0 if reverse else 0.5 * BEFORE
