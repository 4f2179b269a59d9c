"""Timecode generators to which cameras are locked, and the audio of a recorder that receives them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil

import numpy as np

from panoptic_ros.domain import AudioBlock, FrameRate, Timecode
from panoptic_ros.simulation.ltc_signal import AudioFaults, degrade_audio, encode_ltc, timecode_rate

Array = np.ndarray
SECOND = 1_000_000_000
RECORDER = "timecode"  # name of the device that records all generators
SAMPLE_RATE = 48_000
CRYSTAL = 1.0 + 40e-6  # true sample rate of the recorder / its nominal rate: 40 ppm too fast
EARLY_S, LATE_S = 1.5, 0.5  # s; length of the recording before and after the take
NOISE_DB = 30.0  # dB; signal-to-noise ratio of the recorded timecode
BLOCK = 4800  # samples of an audio block


@dataclass(frozen=True)
class Generator:
    """Timecode generator that is also the clock of the cameras locked to it.

    Its cameras expose at the starts of words. Their timestamps follow from the labels: frames since midnight
    / exact rate.

    Args:
        clock: Name of the clock.
        rate: Name of the frame rate, see `timecode_rate`.
        first: Number since midnight of the frame that begins at `begin_s`.
        begin_s: True time in s, the same for all generators.
        drift_ppm: Relative rate error in ppm; positive runs too fast.
    """

    clock: str
    rate: str
    first: int
    begin_s: float = 0.0
    drift_ppm: float = 0.0

    @property
    def frame_rate(self) -> FrameRate:
        """Return the nominal frame rate of the timecode."""
        return timecode_rate(self.rate)

    @property
    def true_rate(self) -> float:
        """Return the number of frames per true second."""
        return float(self.frame_rate.exact) * self._speed

    def stamp_ns(self, true_s: float) -> int:
        """Return the time (ns) that the generator's clock shows at a true time (s)."""
        begin = round(self.first * SECOND / self.frame_rate.exact)
        return begin + round(SECOND * (true_s - self.begin_s) * self._speed)

    @property
    def _speed(self) -> float:
        return 1.0 + 1e-6 * self.drift_ppm

    def sound(self, begin_s: float, count: int, samples_per_s: float, seed: int) -> Array:
        """Return the audio (N,) that a recorder receives from this generator.

        Args:
            begin_s: True time of the first sample, s.
            count: Number of samples.
            samples_per_s: Samples per true second of a recorder with nominal rate `SAMPLE_RATE`.
            seed: Seed of the noise.
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
    """Return the audio (N, C) of one recorder with one generator per channel.

    It begins before the take and ends after it.
    """
    count, rate = int((EARLY_S + seconds + LATE_S) * SAMPLE_RATE), SAMPLE_RATE * CRYSTAL
    heard = [generator.sound(-EARLY_S, count, rate, generator.first) for generator in generators]
    return np.stack(heard, axis=1)


def filmed(generators: Sequence[Generator], locked: Generator, begin_s: float, seconds: float) -> Array:
    """Return the sound track (N, C) of a camera whose frames and samples are clocked by a generator.

    Args:
        generators: Generators on the channels.
        locked: Generator that clocks the camera.
        begin_s: True time of the first sample, s.
        seconds: Duration on the camera's clock, s.
    """
    count = int(seconds * SAMPLE_RATE)
    rate = SAMPLE_RATE * locked.true_rate / float(locked.frame_rate.exact)
    seed = round(1000 * begin_s) + 1000
    return np.stack([one.sound(begin_s, count, rate, seed + one.first) for one in generators], axis=1)


def recorded_blocks(generators: Sequence[Generator], seconds: float) -> list[AudioBlock]:
    """Return `recorded` as audio blocks of the recorder, stamped by its sample count."""
    samples, clocks = recorded(generators, seconds), tuple(generator.clock for generator in generators)
    firsts = range(0, len(samples), BLOCK)
    return [
        AudioBlock(RECORDER, k * SECOND // SAMPLE_RATE, k, SAMPLE_RATE, samples[k : k + BLOCK], clocks)
        for k in firsts
    ]
