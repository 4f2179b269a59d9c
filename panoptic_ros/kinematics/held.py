"""Instants that the lag holds back, with the bodies that were solved at them so far."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

from panoptic_ros.domain.subjects import BodyState


class HeldInstants:
    """The oldest first."""

    def __init__(self) -> None:
        self._instants: deque[tuple[int, int, dict[int, BodyState]]] = deque()

    def __len__(self) -> int:
        return len(self._instants)

    def add(self, index: int, stamp_ns: int) -> None:
        """One more."""
        self._instants.append((index, stamp_ns, {}))

    def keep(self, states: Sequence[BodyState]) -> None:
        """Keep bodies until their instant is given."""
        if states:
            places = {stamp: found for _, stamp, found in self._instants}
            for state in states:
                if state.stamp_ns in places:
                    places[state.stamp_ns][state.id] = state

    def holds(self, number: int) -> bool:
        """Whether a body of this id is among them."""
        return any(number in kept for _, _, kept in self._instants)

    def is_due(self, index: int) -> bool:
        """Whether the oldest is one up to this one."""
        return bool(self._instants) and self._instants[0][0] <= index

    def take(self) -> tuple[int, int, dict[int, BodyState]]:
        """Index, stamp and bodies of the oldest."""
        return self._instants.popleft()
