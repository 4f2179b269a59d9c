"""Timecode generators that cameras are locked to, and what a recorder hears of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil

import numpy as np

from panoptic_ros.domain import AudioBlock, FrameRate, Timecode
from panoptic_ros.simulation.ltc_signal import AudioFaults, degrade_audio, encode_ltc, timecode_rate

Array = np.ndarray
SECOND = 1_000_000_000
RECORDER = "timecode"  # name of the device that hears all of them
SAMPLE_RATE = 48_000
CRYSTAL = 1.0 + 40e-6  # of the recorder: its samples per sample that it says
EARLY_S, LATE_S = 1.5, 0.5  # by which the recording is longer than the take
NOISE_DB = 30.0
BLOCK = 4800  # samples


@dataclass(frozen=True)
class Generator:
    """A timecode generator, and the clock of the cameras that are locked to it.

    Its cameras expose where words begin, and are stamped by what these say: frames since midnight over the
    exact rate.

    Args:
        clock: name. rate: see `timecode_rate`.
        first: number of the frame that begins at `begin_s`, since midnight.
        begin_s: true s, the same for all.
        drift_ppm: how much too fast it runs.
    """

    clock: str
    rate: str
    first: int
    begin_s: float = 0.0
    drift_ppm: float = 0.0

    @property
    def frame_rate(self) -> FrameRate:
        """Of the timecode."""
        return timecode_rate(self.rate)

    @property
    def true_rate(self) -> float:
        """Frames per true second."""
        return float(self.frame_rate.exact) * self._speed

    def stamp_ns(self, true_s: float) -> int:
        """What its clock shows."""
        begin = round(self.first * SECOND / self.frame_rate.exact)
        return begin + round(SECOND * (true_s - self.begin_s) * self._speed)

    @property
    def _speed(self) -> float:
        return 1.0 + 1e-6 * self.drift_ppm

    def sound(self, begin_s: float, count: int, samples_per_s: float, seed: int) -> Array:
        """What a recorder hears of it (N,).

        Args:
            begin_s: true s, of the first sample. count: of samples.
            samples_per_s: per true second, of a recorder that says `SAMPLE_RATE`.
            seed: of the noise.
        """
        number = ceil((begin_s - self.begin_s) * self.true_rate)
        label = Timecode.from_frame_count(self.first + number, self.frame_rate)
        first = self.begin_s + number / self.true_rate
        signal = encode_ltc(
            label,
            int(count / samples_per_s * self.true_rate) + 1,
            SAMPLE_RATE,
            lead=(first - begin_s) * samples_per_s,
            speed=self._speed * SAMPLE_RATE / samples_per_s,
        )
        samples = np.zeros(count, np.float32)
        samples[: len(signal.samples)] = signal.samples[:count]
        return degrade_audio(samples, SAMPLE_RATE, AudioFaults(snr_db=NOISE_DB, seed=seed))


def recorded(generators: Sequence[Generator], seconds: float) -> Array:
    """What one recorder hears of all, each on a channel (N, C), from before to after a take."""
    count, rate = int((EARLY_S + seconds + LATE_S) * SAMPLE_RATE), SAMPLE_RATE * CRYSTAL
    heard = [generator.sound(-EARLY_S, count, rate, generator.first) for generator in generators]
    return np.stack(heard, axis=1)


def filmed(generators: Sequence[Generator], locked: Generator, begin_s: float, seconds: float) -> Array:
    """The sound track (N, C) of a camera that takes pictures and samples by a generator.

    Args:
        generators: on its channels. locked: the generator.
        begin_s: true s, of the first sample. seconds: on the camera's clock.
    """
    count = int(seconds * SAMPLE_RATE)
    rate = SAMPLE_RATE * locked.true_rate / float(locked.frame_rate.exact)
    seed = round(1000 * begin_s) + 1000
    return np.stack([one.sound(begin_s, count, rate, seed + one.first) for one in generators], axis=1)


def recorded_blocks(generators: Sequence[Generator], seconds: float) -> list[AudioBlock]:
    """The same as blocks of the recorder, whose clock is its count of samples."""
    samples, clocks = recorded(generators, seconds), tuple(generator.clock for generator in generators)
    firsts = range(0, len(samples), BLOCK)
    return [
        AudioBlock(RECORDER, k * SECOND // SAMPLE_RATE, k, SAMPLE_RATE, samples[k : k + BLOCK], clocks)
        for k in firsts
    ]
