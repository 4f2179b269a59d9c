"""Sound in a room, from its sources over wall reflections to microphones with their own clocks.

Impulse responses are those of a box. The direct sound and the first reflections come from image sources
(Allen and Berkley 1979). A diffuse tail decays by 60 dB in the reverberation time, with the level that
Sabine's theory predicts. So beyond the critical distance, about a metre in a living room, the tail dominates.
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
ORDER = 2  # largest number of wall reflections of an image source
TAIL_AFTER_S = 0.008  # s from the direct sound to the beginning of the tail
HALF_KERNEL = 16  # samples; half length of a fractionally delayed pulse
FINER = 2  # oversampling factor before a recorder samples the sound


@dataclass(frozen=True)
class AcousticRoom:
    """Box-shaped room with one corner at the origin.

    Args:
        size: Size (x, y, z) m.
        reverberation_s: Time in which sound decays by 60 dB, s.
    """

    size: tuple[float, float, float] = (7.0, 6.0, 3.0)
    reverberation_s: float = 0.5

    @property
    def absorption(self) -> float:
        """Return the share of energy that a wall absorbs, after Sabine."""
        x, y, z = self.size
        return min(0.95, 0.161 * x * y * z / (2.0 * (x * y + y * z + z * x) * self.reverberation_s))

    @property
    def critical_distance(self) -> float:
        """Return the distance (m) at which the direct sound is as loud as the tail."""
        return 0.057 * float(np.sqrt(np.prod(self.size) / self.reverberation_s))

    def response(self, source: Array, microphone: Array, rng: np.random.Generator) -> Array:
        """Return the impulse response (N,) at `RATE`; the direct sound at 1 m distance has amplitude 1.

        Args:
            source, microphone: Positions (3,) m, inside the room.
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
    """Add a band-limited pulse at a fractional sample position."""
    first = int(at) - HALF_KERNEL + 1
    begin, end = max(0, first), min(len(response), first + 2 * HALF_KERNEL)
    if begin < end:
        away = np.arange(begin, end) - at
        response[begin:end] += gain * np.sinc(away) * np.cos(0.5 * np.pi * away / (HALF_KERNEL + 1)) ** 2


@dataclass(frozen=True, eq=False)
class DrySound:
    """Dry sound from one place, without the room.

    Args:
        place: Position (3,) m.
        pieces: Pieces as (true time s, samples (N,) at `RATE`).
    """

    place: Array
    pieces: Sequence[tuple[float, Array]]


@dataclass(frozen=True)
class SimulatedRecorder:
    """Microphone with the clock and the sample counter of its device.

    Sample n has the true time begin_s + n / (sample_rate (1 + drift)). The device clock then shows clock_s +
    n / sample_rate.

    Args:
        place: Position (3,) m.
        sample_rate: Nominal sample rate, Hz.
        drift: Relative rate error of its clock; positive runs too fast.
        snr_db: Level of all sound relative to the microphone's own noise, dB.
    """

    place: tuple[float, float, float]
    sample_rate: int = 48_000
    begin_s: float = 0.0
    clock_s: float = 0.0
    drift: float = 0.0
    snr_db: float = 10.0

    def stamp_s(self, true_s: float) -> float:
        """Return the time (s) that the device clock shows at a true time (s)."""
        return self.clock_s + (true_s - self.begin_s) * (1.0 + self.drift)


def record(
    room: AcousticRoom,
    sounds: Sequence[DrySound],
    recorder: SimulatedRecorder,
    seconds: float,
    seed: Sequence[int],
) -> Array:
    """Return the samples (N,) float32 of a recorder, `seconds` long on its nominal rate, with peak 0.5.

    The result is noise alone where all is silent.
    """
    rng = np.random.default_rng([*seed, 0])
    begin = recorder.begin_s - 0.05  # true time in s, a little before the first sample
    count = int((seconds + 0.1) * RATE)
    heard = np.zeros(count)
    place = np.array(recorder.place)
    for k, sound in enumerate(sounds):
        dry = np.zeros(count + RATE)  # one extra second before, so that tails of earlier sounds are included
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
