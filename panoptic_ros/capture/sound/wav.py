"""WAV files as audio sources."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path

from panoptic_ros.capture.sound.source import BLOCK_S
from panoptic_ros.domain import AudioBlock
from panoptic_ros.errors import DataError
from panoptic_ros.io.wav import WavFile

SECOND = 1_000_000_000
Stamps = Sequence[tuple[int, int]]  # (sample index, its timestamp in ns)


class WavSource:
    """WAV file, timestamped by the clock of the device that recorded it.

    Args:
        clocks: Clocks of the channels, see `AudioBlock`.
        start_ns: Timestamp of the first sample, if there are no `stamps`. The clock is then that of the sound
            card: sample count / sample rate.
        stamps: Timestamps of the samples at which blocks begin.
        from_sample: Index of the first sample to read.

    Raises:
        DataError: if it is not a WAV file, its channels differ from `clocks`, or timestamps do not increase.
    """

    def __init__(
        self,
        device: str,
        path: Path,
        *,
        clocks: Sequence[str] = (),
        start_ns: int = 0,
        stamps: Stamps = (),
        from_sample: int = 0,
    ):
        self.device = device
        self.clocks = tuple(clocks)
        self._file = WavFile(Path(path))
        self._stamps = [(int(sample), int(stamp)) for sample, stamp in stamps] or [(0, int(start_ns))]
        self._from = from_sample
        if self.clocks and len(self.clocks) != self._file.channels:
            raise DataError(
                f"{len(self.clocks)} channels of {path} are named ({', '.join(self.clocks)}), but it has "
                f"{self._file.channels}"
            )
        self._check_stamps()

    @property
    def sample_rate(self) -> int:
        """Return the sample rate in Hz from the file header."""
        return self._file.sample_rate

    @property
    def seconds(self) -> float:
        """Return the duration, s."""
        return len(self._file) / self._file.sample_rate

    def __iter__(self) -> Iterator[AudioBlock]:
        step, end = max(1, int(BLOCK_S * self.sample_rate)), len(self._file)
        bounds = [(max(sample, self._from), stamp - self._ns(sample)) for sample, stamp in self._stamps]
        bounds[0] = self._from, bounds[0][1]
        for (begin, since), (until, _) in pairwise([*bounds, (end, 0)]):
            for first in range(begin, min(until, end), step):
                last = min(first + step, until, end)
                yield AudioBlock(
                    self.device,
                    max(0, since + self._ns(first)),
                    first,
                    self.sample_rate,
                    self._file.samples(first, last),
                    self.clocks,
                )

    def _ns(self, sample: int) -> int:
        return sample * SECOND // self.sample_rate

    def _check_stamps(self) -> None:
        where = f"timestamps.csv, sound of {self.device}"
        for (before, earlier), (sample, stamp) in pairwise(self._stamps):
            if sample <= before or stamp <= earlier:
                raise DataError(f"{where}: sample {sample} at {stamp} ns is not after the previous row")
        counted = [sample for sample, _ in self._stamps] == list(range(len(self._stamps)))
        if counted and len(self._stamps) > 2:
            raise DataError(
                f"{where}: frames 0 to {len(self._stamps) - 1}; of sound, a frame is the index of the first "
                "sample of a block"
            )

    def close(self) -> None:
        """Do nothing: no file stays open."""

    def __enter__(self) -> WavSource:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()
