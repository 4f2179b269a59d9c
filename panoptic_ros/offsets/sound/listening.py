"""The sound of a device as a stream: how its samples and its stamps belong together, and its onsets.

What is compared between microphones is not the waveform. A few metres away, behind the walls' echoes, hardly
a tenth of the energy comes straight, and the peaks of a generalised cross correlation (GCC-PHAT) are as often
an echo's. What all microphones share is when a sound begins: the rise of the energy in some bands over the
noise floor (the onsets of Bello et al. 2005).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from panoptic_ros.domain import AudioBlock
from panoptic_ros.errors import DataError

Array = np.ndarray
SECOND = 1_000_000_000
EDGES = np.geomspace(200.0, 6800.0, 9)  # Hz, of the bands
BANDS = len(EDGES) - 1
USABLE = 0.47  # of the sample rate: what is above is not in the sound
PIECE_S = 2.0
STRAY_S = 0.05  # that stamps may lie beside a line through all
MOST_STAMPS = 20_000  # that the line goes through
FINEST = 4_000  # frames that are transformed together


@dataclass(frozen=True)
class DeviceTime:
    """The samples of a device on its own clock: stamp = start_ns + count / sample_rate (1 + excess).

    A time *heard* is count / sample_rate, in s since the device's first sample.

    Args:
        count: of samples, in all. excess: by which a nominal second of samples is longer on the clock.
    """

    device: str
    sample_rate: int
    start_ns: int
    count: int
    excess: float = 0.0

    @property
    def seconds(self) -> float:
        """How long it is."""
        return self.count / self.sample_rate


class SampleStream:
    """The samples of a device one after the other, as blocks bring them; gaps are silence.

    Channels that carry timecode are left out.

    Raises:
        DataError: while iterating, if blocks go back, or the rate or the number of channels changes.
    """

    def __init__(self, blocks: Iterable[AudioBlock]):
        self._blocks = blocks
        self._stamps: list[tuple[int, int]] = []
        self._every, self._seen = 1, 0
        self.sample_rate = self.count = 0

    def __iter__(self) -> Iterator[Array]:
        """Pieces (N, C) of up to `PIECE_S`."""
        held: list[Array] = []
        first, end, base = 0, 0, 0
        use: list[int] = []
        for block in self._blocks:
            if not self.sample_rate:
                self.sample_rate, base = block.sample_rate, block.first_sample
                use = [c for c in range(block.samples.shape[1]) if not (block.clocks and block.clocks[c])]
                if not use:
                    raise DataError(f"all channels of {block.device} carry timecode, none what is said")
                self.device = block.device
            first = block.first_sample - base
            if first < end or block.sample_rate != self.sample_rate or block.samples.shape[1] <= max(use):
                raise DataError(
                    f"sound of {block.device}: the block at sample {block.first_sample} does not "
                    "follow the one before"
                )
            self._remember(first, block.stamp_ns)
            yield from self._silence(first - end, held, len(use))
            held.append(block.samples[:, use])
            end = first + len(block.samples)
            if sum(map(len, held)) >= PIECE_S * self.sample_rate:
                yield np.concatenate(held)
                held.clear()
        self.count = end
        if held:
            yield np.concatenate(held)

    def _silence(self, count: int, held: list[Array], channels: int) -> Iterator[Array]:
        """What is held, and the gap after it, in pieces."""
        if count and held:
            yield np.concatenate(held)
            held.clear()
        whole = int(PIECE_S * self.sample_rate)
        for begin in range(0, count, whole):
            yield np.zeros((min(whole, count - begin), channels), np.float32)

    def _remember(self, first: int, stamp_ns: int) -> None:
        if self._seen % self._every == 0:
            self._stamps.append((first, stamp_ns))
            if len(self._stamps) > MOST_STAMPS:
                self._stamps, self._every = self._stamps[::2], 2 * self._every
        self._seen += 1

    def time(self) -> DeviceTime:
        """How samples and stamps belong together, once all is read.

        Raises:
            DataError: if no line through the stamps comes near all of them.
        """
        if not self.count:
            raise DataError("a device has no sound")
        counts, stamps = np.array(self._stamps, np.int64).T
        since = 1e-9 * (stamps - stamps[0]) - counts / self.sample_rate
        heard = counts / self.sample_rate
        slope = 0.0
        if heard[-1] > 0.0 and np.ptp(since) > 1e-6:  # whole ns alone make no drift
            slope = float(np.polyfit(heard, since, 1)[0])
        start = float(np.median(since - slope * heard))
        stray = float(np.abs(since - start - slope * heard).max())
        if stray > STRAY_S:
            raise DataError(
                f"stamps of the sound of {self.device} stray from the count of its samples by "
                f"{1e3 * stray:.0f} ms"
            )
        begin = int(stamps[0]) + round(SECOND * start)
        return DeviceTime(self.device, self.sample_rate, begin, self.count, slope)


def band_energies(samples: Array, starts: Array, length: int, sample_rate: int) -> Array:
    """Energy (T, BANDS) float32 of windows, summed over the channels; 0 in bands beyond the sample rate.

    Args:
        samples: (N, C). starts: (T,) of the windows, all inside. length: of the windows.
    """
    window = np.hanning(length + 2)[1:-1].astype(np.float32)
    frequencies = np.fft.rfftfreq(length, 1.0 / sample_rate)
    first = np.searchsorted(frequencies, EDGES)
    energies = np.zeros((len(starts), BANDS), np.float32)
    for begin in range(0, len(starts), FINEST):
        rows = starts[begin : begin + FINEST, None] + np.arange(length)
        for channel in range(samples.shape[1]):
            spectrum = np.fft.rfft(samples[rows, channel] * window, axis=1)
            power = spectrum.real**2 + spectrum.imag**2
            for band in range(BANDS):
                if EDGES[band + 1] <= USABLE * sample_rate:
                    inside = power[:, first[band] : first[band + 1]]
                    energies[begin : begin + FINEST, band] += inside.sum(axis=1)
    return energies


def coarse_energies(stream: SampleStream, rate: float, length_s: float) -> Array:
    """Energies (T, BANDS) of all of a stream; frame k begins k / rate s after the first sample."""
    parts: list[Array] = []
    rest, base, done = np.empty((0, 1), np.float32), 0, 0
    for piece in stream:
        rest = np.concatenate([rest, piece]) if len(rest) else piece
        hop, length = stream.sample_rate / rate, int(length_s * stream.sample_rate)
        end = int((base + len(rest) - length) / hop) + 1
        starts = np.rint(np.arange(done, end) * hop).astype(np.int64)
        starts = starts[starts + length <= base + len(rest)]
        if len(starts):
            parts.append(band_energies(rest, starts - base, length, stream.sample_rate))
            done += len(starts)
            keep = round(done * hop)
            rest, base = rest[keep - base :], keep
    return np.concatenate(parts) if parts else np.empty((0, BANDS), np.float32)


def cut(stream: SampleStream, spans: Sequence[tuple[int, int]]) -> Iterator[Array]:
    """Samples (N, C) of spans of samples, which are in order and do not overlap; what is not there is 0."""
    waiting = list(spans)
    rest, base = np.empty((0, 1), np.float32), 0
    for piece in stream:
        rest = np.concatenate([rest, piece]) if len(rest) else piece
        while waiting and waiting[0][1] <= base + len(rest):
            begin, end = waiting.pop(0)
            yield _between(rest, begin - base, end - base)
        gone = min(len(rest), max(0, (waiting[0][0] if waiting else base + len(rest)) - base))
        rest, base = rest[gone:], base + gone
        if not waiting:
            return
    for begin, end in waiting:
        yield _between(rest, begin - base, end - base)


def _between(samples: Array, begin: int, end: int) -> Array:
    inside = samples[max(0, begin) : max(0, end)]
    before = min(end - begin, max(0, -begin))
    after = end - begin - before - len(inside)
    return np.pad(inside, ((before, after), (0, 0)))
