"""Which instants a late stage leaves out, so that it catches up.

With data that have waited for n sixtieths of a second, one instant of n is solved, and the steps between are
so much longer. That settles: the fewer instants a machine can solve, the longer its data wait,
and the fewer are solved.
"""

from __future__ import annotations

WAIT_NS = 1_000_000_000 // 60  # twice of it is more than a node waits that solves for four people in time
LONGEST_S = 0.1  # from one instant that is solved to the next


class Pace:
    """Decides, instant by instant.

    Args:
        rate_hz: of the instants.
    """

    def __init__(self, rate_hz: float):
        self._most = max(1, int(LONGEST_S * rate_hz + 1e-9))
        self.waited_ns = 0  # by what is at hand, before the stage came to it
        self._left_out = 0  # instants since the last one that was solved

    def step(self) -> int:
        """Another instant is due: periods since the last one that was solved, or 0 if it is left out."""
        wanted = min(max(1, self.waited_ns // WAIT_NS), self._most)
        if self._left_out + 1 < wanted:
            self._left_out += 1
            return 0
        stride, self._left_out = self._left_out + 1, 0
        return stride
