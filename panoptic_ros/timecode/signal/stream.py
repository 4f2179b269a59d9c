"""The newest part of one device's samples: as recorded, and as the running sum of the conditioned signal."""

from __future__ import annotations

import numpy as np

from panoptic_ros.timecode.signal.buffer import Buffer
from panoptic_ros.timecode.signal.conditioning import Conditioner
from panoptic_ros.timecode.signal.grid import Grid
from panoptic_ros.timecode.signal.wave import Samples

Array = np.ndarray
KEPT_SECONDS = 1.0  # of samples: a signal that is found late is read from there on
BUFFER_SECONDS = 4.0


class Stream:
    """Samples of one uninterrupted stream.

    Grids of words are in recorded samples since the stream's start. The running sum has `up` values for each
    recorded sample and begins at the first that is kept.

    Attributes:
        sample_rate: Hz, of the recorded samples.
        first: index of the first recorded sample that is kept.
    """

    def __init__(self, sample_rate: int, high_pass_hz: float):
        self.sample_rate = sample_rate
        self.first = 0
        self._conditioner = Conditioner(sample_rate, high_pass_hz)
        self._up = self._conditioner.up  # conditioned samples per recorded one
        self._raw = Buffer(int(BUFFER_SECONDS * sample_rate))
        self._sums = Buffer(int(BUFFER_SECONDS * sample_rate) * self._up)
        self._sums.append(np.zeros(1))

    @property
    def recorded(self) -> Samples:
        """The samples as recorded, from `first` on."""
        return Samples(self.first, self._raw.values)

    @property
    def sums(self) -> Array:
        """(M + 1,) running sum of the conditioned samples."""
        return self._sums.values

    @property
    def sums_rate(self) -> int:
        """Conditioned samples per second."""
        return self.sample_rate * self._up

    @property
    def delay(self) -> int:
        """Samples by which the conditioned signal is behind the recorded one."""
        return self._conditioner.reach

    def append(self, samples: Array) -> None:
        """Take the next samples (N,)."""
        self._raw.append(samples)
        signal = self._conditioner.push(samples)
        self._sums.append(np.cumsum(signal) + self._sums.values[-1])

    def forget(self) -> None:
        """Drop all samples but those of the last second."""
        surplus = len(self._raw.values) - int(KEPT_SECONDS * self.sample_rate)
        if surplus > 0:
            self._raw.drop(surplus)
            self._sums.drop(surplus * self._up)
            self.first += surplus

    def holds(self, sample: float) -> bool:
        """Whether the signal is conditioned up to a sample."""
        return bool(sample <= self.first + (len(self._sums.values) - 1) // self._up)

    def in_recorded(self, grid: Grid) -> Grid:
        """A grid on the running sum as one in recorded samples."""
        return Grid(self.first + grid.middle / self._up, grid.cell / self._up)

    def in_sums(self, grid: Grid) -> Grid:
        """A grid in recorded samples as one on the running sum."""
        return Grid((grid.middle - self.first) * self._up, grid.cell * self._up)

    def ticks_in_recorded(self, ticks: Array) -> Array:
        """Places on the running sum as recorded samples."""
        return self.first + ticks / self._up

    def ticks_in_sums(self, ticks: Array) -> Array:
        """Recorded samples as places on the running sum."""
        return (ticks - self.first) * self._up
