"""The newest part of a stream."""
from __future__ import annotations

import numpy as np

Array = np.ndarray


class Buffer:
    """The newest values of a stream, in one piece."""

    def __init__(self, capacity: int):
        self._store = np.empty(capacity)
        self._begin = self._end = 0

    @property
    def values(self) -> Array:
        """Those that are kept."""
        return self._store[self._begin : self._end]

    def append(self, values: Array) -> None:
        """Add at the end."""
        count = self._end - self._begin
        if self._end + len(values) > len(self._store):
            kept = self.values.copy()
            if count + len(values) > len(self._store):
                self._store = np.empty(2 * (count + len(values)))
            self._store[:count] = kept
            self._begin, self._end = 0, count
        self._store[self._end : self._end + len(values)] = values
        self._end += len(values)

    def drop(self, count: int) -> None:
        """Forget the oldest."""
        self._begin += count
