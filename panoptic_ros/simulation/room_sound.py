"""Sound in a room: from where it is made, over walls, to microphones with clocks of their own.

Impulse responses are those of a box: the direct sound and its first reflections by image sources (Allen and
Berkley 1979), and a diffuse tail that falls by 60 dB in the reverberation time, as loud as Sabine's theory
has it. So beyond the critical distance, a metre in a living room, most of what is heard is tail.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.ndimage import map_coordinates
from scipy.signal import oaconvolve, resample_poly

from panoptic_ros.simulation.voices import RATE

Array = np.ndarray
SPEED_OF_SOUND = 343.0  # m/s
ORDER = 2  # walls that an image has been reflected by, at most
TAIL_AFTER_S = 0.008  # from the direct sound
HALF_KERNEL = 16  # samples of a delayed pulse
FINER = 2  # by which sound is resampled before a recorder takes it


@dataclass(frozen=True)
class Room:
    """A box from the origin on.

    Args:
        size: (x, y, z) m. reverberation_s: in which sound falls by 60 dB.
    """

    size: tuple[float, float, float] = (7.0, 6.0, 3.0)
    reverberation_s: float = 0.5

    @property
    def absorption(self) -> float:
        """Share of the energy that a wall takes, after Sabine."""
        x, y, z = self.size
        return min(0.95, 0.161 * x * y * z / (2.0 * (x * y + y * z + z * x) * self.reverberation_s))

    @property
    def critical_distance(self) -> float:
        """Where the direct sound is as loud as the tail, m."""
        return 0.057 * float(np.sqrt(np.prod(self.size) / self.reverberation_s))

    def response(self, source: Array, microphone: Array, rng: np.random.Generator) -> Array:
        """Impulse response (N,) at `RATE`, 1 at a distance of 1 m without walls.

        Args:
            source, microphone: (3,) m, inside of the room.
        """
        direct = float(np.linalg.norm(source - microphone))
        length = int((direct / SPEED_OF_SOUND + self.reverberation_s) * RATE) + 2 * HALF_KERNEL
        response = np.zeros(length)
        kept = np.sqrt(1.0 - self.absorption)
        size = np.array(self.size)
        for cell in product(range(-ORDER, ORDER + 1), repeat=3):
            walls = int(np.abs(cell).sum())
            if walls <= ORDER:
                cells = np.array(cell)
                image = cells * size + np.where(cells % 2 == 0, source, size - source)
                distance = float(np.linalg.norm(image - microphone))
                _add_pulse(response, distance / SPEED_OF_SOUND * RATE, kept**walls / max(distance, 0.1))
        time = np.arange(length) / RATE
        tail = rng.standard_normal(length) * 10.0 ** (-3.0 * time / self.reverberation_s)
        tail[: int((direct / SPEED_OF_SOUND + TAIL_AFTER_S) * RATE)] = 0.0
        whole = 10.0 ** (-3.0 * time / self.reverberation_s)
        return np.asarray(response + tail / (np.linalg.norm(whole) * self.critical_distance))


def _add_pulse(response: Array, at: float, gain: float) -> None:
    """Add a pulse of all frequencies at a fractional sample."""
    first = int(at) - HALF_KERNEL + 1
    begin, end = max(0, first), min(len(response), first + 2 * HALF_KERNEL)
    if begin < end:
        away = np.arange(begin, end) - at
        response[begin:end] += gain * np.sinc(away) * np.cos(0.5 * np.pi * away / (HALF_KERNEL + 1)) ** 2


@dataclass(frozen=True, eq=False)
class DrySound:
    """What somebody or something makes at one place.

    Args:
        place: (3,) m. pieces: (true s, samples (N,) at `RATE`).
    """

    place: Array
    pieces: Sequence[tuple[float, Array]]


@dataclass(frozen=True)
class Recorder:
    """A microphone, and the clock and the counting of the device behind it.

    Its sample n is of true time begin_s + n / (sample_rate (1 + drift)), and its clock shows
    clock_s + n / sample_rate then.

    Args:
        place: m. sample_rate: Hz, as it says. drift: how much too fast its clock runs.
        snr_db: all sound over the noise of its own.
    """

    place: tuple[float, float, float]
    sample_rate: int = 48_000
    begin_s: float = 0.0
    clock_s: float = 0.0
    drift: float = 0.0
    snr_db: float = 10.0

    def stamp_s(self, true_s: float) -> float:
        """What its clock shows."""
        return self.clock_s + (true_s - self.begin_s) * (1.0 + self.drift)


def record(
    room: Room, sounds: Sequence[DrySound], recorder: Recorder, seconds: float, seed: Sequence[int]
) -> Array:
    """What a recorder has (N,) float32 after so many seconds, peak 0.5; noise alone where all is silent."""
    rng = np.random.default_rng([*seed, 0])
    begin = recorder.begin_s - 0.05  # s of the common time line before the first sample
    count = int((seconds + 0.1) * RATE)
    heard = np.zeros(count)
    place = np.array(recorder.place)
    for k, sound in enumerate(sounds):
        dry = np.zeros(count + RATE)  # from a second before, so that tails of what was before are there
        for at, piece in sound.pieces:
            _add(dry, round((at - begin + 1.0) * RATE), piece)
        if dry.any():
            response = room.response(sound.place, place, np.random.default_rng([*seed, 1, k]))
            heard += oaconvolve(dry, response)[RATE : RATE + count]
    power = float(np.mean(heard**2)) or 1.0
    heard += np.sqrt(power * 10.0 ** (-recorder.snr_db / 10.0)) * rng.standard_normal(count)
    fine = resample_poly(heard, FINER, 1)
    times = np.arange(int(seconds * recorder.sample_rate)) / (recorder.sample_rate * (1.0 + recorder.drift))
    samples = map_coordinates(fine, [(times + 0.05) * RATE * FINER], order=3, mode="nearest")
    return (0.5 * samples / max(1e-9, float(np.abs(samples).max()))).astype(np.float32)


def _add(track: Array, first: int, piece: Array) -> None:
    begin, end = max(0, first), min(len(track), first + len(piece))
    if begin < end:
        track[begin:end] += piece[begin - first : end - first]
