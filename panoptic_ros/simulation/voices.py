"""Dry sounds of talk and claps, without the acoustics of a room."""

from __future__ import annotations

import numpy as np
from scipy.signal import butter, lfilter, sosfilt

Array = np.ndarray
RATE = 16_000  # Hz; sample rate of dry sounds
SYLLABLES = (3.0, 5.5)  # syllables per second, from and to
VOICED = 0.75  # share of voiced syllables
PITCH = (95.0, 230.0)  # Hz; range of the voice pitch
FORMANTS = ((300.0, 800.0), (900.0, 2200.0), (2300.0, 3200.0))  # Hz; frequency ranges of three formants
CLAP_BAND = (500.0, 5000.0)  # Hz; pass band of a clap's noise


def talk(rng: np.random.Generator, seconds: float) -> Array:
    """Return a sentence-like sound (N,) of one person: syllables with pauses, rms 1 over its length."""
    pitch = rng.uniform(*PITCH)
    sound = np.zeros(int(seconds * RATE))
    at = 0.0
    while at < seconds - 0.1:
        length = min(rng.uniform(0.08, 0.28), seconds - at)
        piece = _syllable(rng, pitch * rng.uniform(0.85, 1.2), length) * rng.lognormal(0.0, 0.4)
        begin = int(at * RATE)
        sound[begin : begin + len(piece)] += piece[: len(sound) - begin]
        pause = rng.uniform(0.3, 0.7) if rng.random() < 0.12 else 0.0
        at += max(length, 1.0 / rng.uniform(*SYLLABLES)) + pause
    return np.asarray(sound / max(1e-9, float(np.sqrt(np.mean(sound**2)))))


def _syllable(rng: np.random.Generator, pitch: float, length: float) -> Array:
    count = int(length * RATE)
    noise = rng.standard_normal(count)
    if rng.random() < VOICED:
        melody = 0.15 * np.sin(np.linspace(0.0, rng.uniform(1.0, 4.0), count))
        phase = np.cumsum(pitch * (1.0 + melody)) / RATE
        pulses = np.diff(np.floor(phase), prepend=0.0)
        source = 6.0 * pulses + 0.05 * noise
        for low, high in FORMANTS:
            turn, damping = 2.0 * np.pi * rng.uniform(low, high) / RATE, np.exp(-np.pi * 90.0 / RATE)
            poles = [1.0, -2.0 * damping * np.cos(turn), damping**2]
            source = source + lfilter([1.0 - damping], poles, source)
    else:
        source = sosfilt(butter(2, rng.uniform(1500.0, 3500.0), "high", fs=RATE, output="sos"), noise)
    rise = rng.uniform(0.01, 0.04)
    time = np.arange(count) / RATE
    shape = np.minimum(1.0, time / rise) * np.minimum(1.0, (length - time) / (0.4 * length))
    return np.asarray(source * shape / max(1e-9, float(np.sqrt(np.mean(source**2)))))


def clap(rng: np.random.Generator) -> Array:
    """Return one hand clap (N,), peak about 1."""
    time = np.arange(int(0.08 * RATE)) / RATE
    shape = np.minimum(1.0, time / 0.001) * np.exp(-time / rng.uniform(0.004, 0.012))
    noise = rng.standard_normal(len(time))
    burst = sosfilt(butter(2, CLAP_BAND, "band", fs=RATE, output="sos"), noise * shape)
    return np.asarray(burst / max(1e-9, float(np.abs(burst).max())))
