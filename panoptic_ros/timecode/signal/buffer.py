"""Parts of a stream: the newest values in one piece, and hops of fixed length."""

from __future__ import annotations

import numpy as np

Array = np.ndarray


class Buffer:
    """The newest values of a stream, in one piece."""

    def __init__(self, capacity: int):
        self._store = np.empty(capacity)
        self._begin = self._end = 0

    @classmethod
    def of(cls, values: Array) -> Buffer:
        """A buffer that holds values (N,)."""
        buffer = cls(len(values))
        buffer.append(values)
        return buffer

    @property
    def values(self) -> Array:
        """(N,) the values that are kept."""
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


class Hops:
    """Cuts a stream into hops of fixed length, so that nothing depends on how it was cut into blocks."""

    def __init__(self, length: int):
        self._length = length
        self._pending: list[Array] = []
        self._count = 0

    def push(self, samples: Array) -> list[Array]:
        """The hops (length,) that became complete."""
        self._pending.append(samples)
        self._count += len(samples)
        if self._count < self._length:
            return []
        joined = np.concatenate(self._pending).astype(np.float64)
        whole = len(joined) - len(joined) % self._length
        self._pending, self._count = [joined[whole:]], len(joined) - whole
        return [joined[first : first + self._length] for first in range(0, whole, self._length)]

    def finish(self, silence: int) -> Array:
        """What is left, and samples of silence after it."""
        rest = np.concatenate([*self._pending, np.zeros(silence)])
        self._pending, self._count = [], 0
        return rest
