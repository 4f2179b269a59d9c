"""Read the sound of a device as a stream: relation of samples to timestamps, and band energies.

Microphones are not compared by their waveforms. A few metres from a source, hardly a tenth of the energy
arrives directly. The peaks of a generalised cross correlation (GCC-PHAT) then often belong to an echo. All
microphones share the time at which a sound begins. It is the rise of the energy in some bands over the noise
floor (the onsets of Bello et al. 2005).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from panoptic_ros.domain import AudioBlock
from panoptic_ros.errors import DataError

Array = np.ndarray
SECOND = 1_000_000_000
EDGES = np.geomspace(200.0, 6800.0, 9)  # Hz, edges of the bands
BANDS = len(EDGES) - 1
USABLE = 0.47  # share of the sample rate above which the sound has no content
PIECE_S = 2.0
STRAY_S = 0.05  # s, maximum distance of timestamps from a line through all of them
MOST_STAMPS = 20_000  # maximum number of timestamps for the line fit
FINEST = 4_000  # number of frames transformed at once


@dataclass(frozen=True)
class DeviceTime:
    """Sample time of a device on its own clock: timestamp = start_ns + count / sample_rate (1 + excess).

    A time *heard* is count / sample_rate, in s since the device's first sample.

    Args:
        device: name of the device.
        sample_rate: (Hz) nominal sample rate.
        start_ns: (ns) timestamp of the first sample.
        count: total number of samples.
        excess: relative excess of the clock time over the nominal duration of the samples.
    """

    device: str
    sample_rate: int
    start_ns: int
    count: int
    excess: float = 0.0

    @property
    def seconds(self) -> float:
        """Return the nominal duration, s."""
        return self.count / self.sample_rate


class SampleStream:
    """Consecutive samples of a device from its audio blocks; gaps are filled with silence.

    Channels that carry timecode are skipped.

    Raises:
        DataError: during iteration, if blocks go back, or the rate or the number of channels changes.
    """

    def __init__(self, blocks: Iterable[AudioBlock]):
        self._blocks = blocks
        self._stamps: list[tuple[int, int]] = []
        self._every, self._seen = 1, 0
        self.sample_rate = self.count = 0

    def __iter__(self) -> Iterator[Array]:
        """Yield pieces (N, C) of about `PIECE_S`."""
        held: list[Array] = []
        first, end, base = 0, 0, 0
        use: list[int] = []
        for block in self._blocks:
            if not self.sample_rate:
                self.sample_rate, base = block.sample_rate, block.first_sample
                use = [c for c in range(block.samples.shape[1]) if not (block.clocks and block.clocks[c])]
                if not use:
                    raise DataError(
                        f"all channels of {block.device} carry timecode, none carries sound of the room"
                    )
                self.device = block.device
            first = block.first_sample - base
            if first < end or block.sample_rate != self.sample_rate or block.samples.shape[1] <= max(use):
                raise DataError(
                    f"sound of {block.device}: the block at sample {block.first_sample} does not follow "
                    "the previous one"
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
        """Yield the buffered samples, and the gap after them as pieces of silence."""
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
        """Return the relation of samples to timestamps, once the stream has been read.

        Raises:
            DataError: there is no sound, or no line lies close to all timestamps.
        """
        if not self.count:
            raise DataError("a device has no sound")
        counts, stamps = np.array(self._stamps, np.int64).T
        since = 1e-9 * (stamps - stamps[0]) - counts / self.sample_rate
        heard = counts / self.sample_rate
        slope = 0.0
        if heard[-1] > 0.0 and np.ptp(since) > 1e-6:  # rounding to whole ns alone gives no drift
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
    """Return the energy (T, BANDS) float32 of windows, summed over channels; 0 in unusable bands.

    Bands above `USABLE` times the sample rate are unusable.

    Args:
        samples: (N, C).
        starts: (T,) first sample of each window; all windows are inside.
        length: (samples) length of a window.
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
    """Return the energies (T, BANDS) of a whole stream; frame k begins k / rate s after the first sample."""
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
    """Yield the samples (N, C) of ordered, disjoint sample spans; missing samples are 0."""
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
