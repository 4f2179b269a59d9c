"""When samples were at the input of a device, though blocks tell of it late, and sometimes early."""

from __future__ import annotations

from bisect import bisect_left, insort
from collections import deque

SECOND = 1_000_000_000
KEPT_S = 5.0  # in which some blocks come promptly; a clock that drifts by 1e-4 moves by half a ms
PROMPT = 0.05  # share of the blocks that tell of an earlier time: these are the wrong ones
LOST_NS = SECOND  # later than the count says: sound was lost, or the machine slept


class SteadyStamps:
    """Stamps that go on as the samples do, from the blocks that came promptly.

    A block is told of late, by up to 0.1 s on a busy machine. So those that are earliest beside their count
    of samples are right (the minimum filter of clocks over networks, Mills 1991), but for a few: sound
    servers guess how long sound took through them, at times too long. Hence the earliest but for a twentieth.

    Args:
        sample_rate: Hz.
    """

    def __init__(self, sample_rate: int):
        self._rate = sample_rate
        self._starts: deque[tuple[int, int]] = deque()  # (sample, ns of sample 0)
        self._sorted: list[int] = []  # the ns of these
        self._last = 0

    def stamp(self, first: int, told_ns: int) -> int:
        """Of a block that begins with a sample, which the device told of as of a time; never goes back."""
        start = told_ns - first * SECOND // self._rate
        if self._starts and start - self._prompt() >= LOST_NS:
            self.restart()
        self._starts.append((first, start))
        insort(self._sorted, start)
        while self._starts[0][0] < first - KEPT_S * self._rate:
            del self._sorted[bisect_left(self._sorted, self._starts.popleft()[1])]
        self._last = max(self._prompt() + first * SECOND // self._rate, self._last + 1, 0)
        return self._last

    def restart(self) -> None:
        """After sound was lost: the count tells nothing of before."""
        self._starts.clear()
        self._sorted.clear()

    def _prompt(self) -> int:
        return self._sorted[int(PROMPT * len(self._sorted))]
