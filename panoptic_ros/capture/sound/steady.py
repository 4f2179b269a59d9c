"""When samples were at the input of a device, though each block tells of it late, by more or less."""
from __future__ import annotations

from collections import deque

SECOND = 1_000_000_000
KEPT_S = 5.0  # in which some block comes promptly; a clock that drifts by 1e-4 moves by half a ms
LOST_NS = SECOND  # later than the count says: sound was lost, or the machine slept


class SteadyStamps:
    """Stamps that go on as the samples do, from the blocks that came most promptly.

    A block is told of late, by up to 0.1 s on a busy machine, and never early: so those that are earliest
    beside their count of samples are right (the minimum filter of clocks over networks, Mills 1991).

    Args:
        sample_rate: Hz.
    """

    def __init__(self, sample_rate: int):
        self._rate = sample_rate
        self._starts: deque[tuple[int, int]] = deque()  # (sample, ns of sample 0), later ones larger
        self._last = 0

    def stamp(self, first: int, told_ns: int) -> int:
        """Of a block that begins with a sample, which the device told of as of a time; never goes back."""
        start = told_ns - first * SECOND // self._rate
        if self._starts and start - self._starts[0][1] >= LOST_NS:
            self._starts.clear()
        while self._starts and self._starts[-1][1] >= start:
            self._starts.pop()
        self._starts.append((first, start))
        while self._starts[0][0] < first - KEPT_S * self._rate:
            self._starts.popleft()
        self._last = max(self._starts[0][1] + first * SECOND // self._rate, self._last + 1, 0)
        return self._last

    def restart(self) -> None:
        """After sound was lost: the count tells nothing of before."""
        self._starts.clear()
