"""Keep the newest part of one device's samples, as the running sum of the conditioned signal."""

from __future__ import annotations

import numpy as np

from panoptic_ros.timecode.signal.conditioning import Conditioner
from panoptic_ros.timecode.signal.half_cells import CellGrid

Array = np.ndarray
KEPT_SECONDS = 1.0  # s of samples to keep: a signal found late is read from there on
BUFFER_SECONDS = 4.0  # s, initial capacity of the running sum


class Buffer:
    """Growing buffer of the newest values of a stream, contiguous in memory."""

    def __init__(self, capacity: int):
        self._store = np.empty(capacity)
        self._begin = self._end = 0

    @classmethod
    def of(cls, values: Array) -> Buffer:
        """Create a buffer that holds values (N,)."""
        buffer = cls(len(values))
        buffer.append(values)
        return buffer

    @property
    def values(self) -> Array:
        """Return the buffered values (N,)."""
        return self._store[self._begin : self._end]

    def append(self, values: Array) -> None:
        """Append values (N,) at the end."""
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
        """Drop the oldest `count` values."""
        self._begin += count


class Hops:
    """Splitter of a stream into hops of fixed length, so that results do not depend on the block size."""

    def __init__(self, length: int):
        self._length = length
        self._pending: list[Array] = []
        self._count = 0

    def push(self, samples: Array) -> list[Array]:
        """Append samples and return the hops (length,) that are now complete."""
        self._pending.append(samples)
        self._count += len(samples)
        if self._count < self._length:
            return []
        joined = np.concatenate(self._pending).astype(np.float64)
        whole = len(joined) - len(joined) % self._length
        self._pending, self._count = [joined[whole:]], len(joined) - whole
        return [joined[first : first + self._length] for first in range(0, whole, self._length)]

    def finish(self, silence: int) -> Array:
        """Return the remaining samples, followed by `silence` zero samples."""
        rest = np.concatenate([*self._pending, np.zeros(silence)])
        self._pending, self._count = [], 0
        return rest


class Stream:
    """Conditioned samples of one uninterrupted stream.

    Grids of words are in recorded samples since the start of the stream. The running sum has `up` values per
    recorded sample and begins at the first sample kept.

    Attributes:
        sample_rate: Hz, rate of the recorded samples.
        first: index of the first recorded sample that is kept.
        up: conditioned samples per recorded sample.
    """

    def __init__(self, sample_rate: int, high_pass_hz: float):
        self.sample_rate = sample_rate
        self.first = 0
        self._conditioner = Conditioner(sample_rate, high_pass_hz)
        self.up = self._conditioner.up
        self._recorded = 0  # number of recorded samples since `first`
        self._sums = Buffer(int(BUFFER_SECONDS * sample_rate) * self.up)
        self._sums.append(np.zeros(1))

    @property
    def sums(self) -> Array:
        """Return the running sum (M + 1,) of the conditioned samples."""
        return self._sums.values

    @property
    def sums_rate(self) -> int:
        """Return the number of conditioned samples per second."""
        return self.sample_rate * self.up

    @property
    def delay(self) -> int:
        """Return the number of recorded samples by which conditioning delays the signal."""
        return self._conditioner.reach

    def append(self, samples: Array) -> None:
        """Condition the next samples (N,) and append them to the running sum."""
        self._recorded += len(samples)
        signal = self._conditioner.push(samples)
        self._sums.append(np.cumsum(signal) + self._sums.values[-1])

    def forget(self) -> None:
        """Drop all samples older than `KEPT_SECONDS`."""
        surplus = self._recorded - int(KEPT_SECONDS * self.sample_rate)
        if surplus > 0:
            self._recorded -= surplus
            self._sums.drop(surplus * self.up)
            self.first += surplus

    def holds(self, sample: float) -> bool:
        """Return whether the signal is conditioned up to a recorded sample."""
        return bool(sample <= self.first + (len(self._sums.values) - 1) // self.up)

    def in_recorded(self, grid: CellGrid) -> CellGrid:
        """Convert a grid on the running sum to recorded samples."""
        return CellGrid(self.first + grid.middle / self.up, grid.cell / self.up)

    def in_sums(self, grid: CellGrid) -> CellGrid:
        """Convert a grid in recorded samples to the running sum."""
        return CellGrid((grid.middle - self.first) * self.up, grid.cell * self.up)

    def ticks_in_recorded(self, ticks: Array) -> Array:
        """Convert positions on the running sum to recorded samples."""
        return self.first + ticks / self.up

    def ticks_in_sums(self, ticks: Array) -> Array:
        """Convert recorded samples to positions on the running sum."""
        return (ticks - self.first) * self.up
