"""The instants that were solved of late, and which of them are the lag ago: late ones are left out."""

from __future__ import annotations

from collections import deque

KEPT = 64


class Past:
    """Stamps of instants, and how many periods each came after the one before."""

    def __init__(self) -> None:
        self._stamps: deque[int] = deque(maxlen=KEPT)
        self._strides: deque[int] = deque(maxlen=KEPT)
        self._held = 0  # instants that were not given yet

    def __len__(self) -> int:
        return len(self._stamps)

    def add(self, stamp_ns: int, stride: int) -> None:
        """One more instant."""
        self._stamps.append(stamp_ns)
        self._strides.append(stride)
        self._held += 1

    def stamp(self, back: int) -> int:
        """Of so many instants ago, ns."""
        return self._stamps[-1 - back]

    def around(self, back: int) -> int:
        """Periods from the instant before the one of so many instants ago to the one after it, if any."""
        return self._strides[-1 - back] + (self._strides[-back] if back else 0)

    def due(self, lag: int) -> list[int]:
        """Instants that are so many periods ago and were not given yet, the oldest first; they are now."""
        found = []
        ago = sum(list(self._strides)[1 - self._held :]) if self._held > 1 else 0  # periods, of the oldest
        while self._held and ago >= lag:
            self._held -= 1
            found.append(self._held)
            ago -= self._strides[-self._held] if self._held else 0
        return found

    def left(self, lag: int) -> list[int]:
        """Instants less than the lag ago, the oldest first."""
        return list(range(min(lag, self._held, len(self._stamps)) - 1, -1, -1))
