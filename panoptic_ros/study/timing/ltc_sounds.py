"""Sounds without timecode; every word that a decoder reads in them is false."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from scipy.signal import lfilter

Array = np.ndarray
# arguments: generator, number of samples, sample rate in Hz
Sound = Callable[[np.random.Generator, int, int], Array]
PIECE_SECONDS = 20.0


def sounds(seconds: float, sample_rate: int, seed: int) -> Iterator[tuple[str, Array]]:
    """Yield pieces (N,) float32 of all kinds in turn, of this total length."""
    rng = np.random.default_rng(seed)
    done, number = 0.0, 0
    while done < seconds:
        name = list(KINDS)[number % len(KINDS)]
        length = min(PIECE_SECONDS, seconds - done)
        samples = KINDS[name](rng, int(length * sample_rate), sample_rate)
        yield name, (0.3 * samples / max(1e-9, np.abs(samples).max())).astype(np.float32)
        done, number = done + length, number + 1


def _white(rng: np.random.Generator, count: int, rate: int) -> Array:
    return rng.standard_normal(count)


def _pink(rng: np.random.Generator, count: int, rate: int) -> Array:
    """Return white noise through a third-order filter, about -3 dB per octave."""
    noise = rng.standard_normal(count)
    return lfilter([0.04992, -0.09599, 0.05061, -0.00441], [1.0, -2.494956, 2.017266, -0.522190], noise)


def _speech(rng: np.random.Generator, count: int, rate: int) -> Array:
    """Return speech-like sound with pauses.

    Voice pulses of varying pitch pass through formants that change with each syllable.
    """
    out = np.zeros(count)
    begin = 0
    while begin < count:
        length = int(rng.uniform(0.08, 0.35) * rate)
        end = min(count, begin + length)
        pitch = rng.uniform(90.0, 250.0) * (1.0 + 0.1 * np.sin(np.arange(end - begin) / rate * 20.0))
        phase = np.cumsum(pitch / rate)
        voice = np.diff(np.floor(phase), prepend=0.0) + 0.02 * rng.standard_normal(end - begin)
        for formant in (rng.uniform(300, 800), rng.uniform(900, 2300), rng.uniform(2400, 3200)):
            radius = 1.0 - np.pi * 90.0 / rate
            turn = -2.0 * radius * np.cos(2.0 * np.pi * formant / rate)
            voice = lfilter([1.0], [1.0, turn, radius**2], voice)
        out[begin:end] = voice / max(1e-9, np.abs(voice).max()) * np.hanning(end - begin)
        begin = end + int(rng.choice([0.0, 0.05, 0.4]) * rate)
    return out


def _music(rng: np.random.Generator, count: int, rate: int) -> Array:
    """Return chords of plucked harmonic tones and drums, 120 beats per minute."""
    out = np.zeros(count)
    beat = rate // 2
    time = np.arange(2 * beat) / rate
    for begin in range(0, count, beat):
        root = 55.0 * 2.0 ** (rng.integers(0, 36) / 12.0)
        for step in rng.choice([0, 3, 4, 7, 10, 12, 16, 19], 4, replace=False):
            tone = root * 2.0 ** (step / 12.0)
            note = sum(np.sin(2 * np.pi * k * tone * time) / k for k in range(1, 9)) * np.exp(-3.0 * time)
            end = min(count, begin + len(time))
            out[begin:end] += note[: end - begin]
        drum = rng.standard_normal(beat // 4) * np.exp(-np.arange(beat // 4) / 600.0)
        end = min(count, begin + len(drum))
        out[begin:end] += 2.0 * drum[: end - begin]
    return out


def _square_fm(rng: np.random.Generator, count: int, rate: int) -> Array:
    """Return a square wave with about the frequency of timecode, switched at random."""
    tones = rng.choice([900.0, 1000.0, 1200.0, 2000.0, 2400.0], count // 200 + 1)
    return np.where(np.cumsum(np.repeat(tones, 200)[:count] / rate) % 1.0 < 0.5, 1.0, -1.0)


def _biphase(rng: np.random.Generator, count: int, rate: int) -> Array:
    """Return biphase mark code as in timecode, with random bits."""
    halves: list[float] = []
    sign = 1.0
    cell = rate / (80.0 * rng.choice([24.0, 25.0, 30.0]))
    for bit in rng.integers(0, 2, int(count / cell) + 2):
        halves += [sign, -sign if bit else sign]
        sign = sign if bit else -sign
    signal: Array = np.array(halves)[(np.arange(count) / (0.5 * cell)).astype(np.int64)]
    return signal


KINDS: dict[str, Sound] = {
    "white noise": _white,
    "pink noise": _pink,
    "speech-like": _speech,
    "music-like": _music,
    "square FM": _square_fm,
    "random biphase": _biphase,
}
