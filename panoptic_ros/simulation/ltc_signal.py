"""Linear timecode (SMPTE ST 12-1) as audio, with the exact start of every word, and faults of the audio.

The signal is built edge by edge at fractional sample positions, independently of `timecode/`, so that the
encoder and the decoder check each other. The code is biphase mark: a transition at the start of every bit,
and another in the middle of a one. Edges are Gaussian steps of 40 us rise time (10 to 90 %), or slower where
the sample rate limits them.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from scipy.special import erf

from panoptic_ros.domain import FrameRate, Timecode
from panoptic_ros.errors import UsageError

Array = np.ndarray
BITS = 80
RISE_SECONDS = 40e-6
BAND_LIMIT = 0.45  # samples; smallest standard deviation of an edge after a recorder's low pass
SYNC_BITS = (0, 0) + (1,) * 12 + (0, 1)  # bits 64 to 79 in transmission order


@dataclass(frozen=True, slots=True, eq=False)
class LtcSignal:
    """Timecode audio and its ground truth.

    Args:
        samples: Samples (N,) float32.
        sample_rate: Sample rate in Hz.
        labels: Label of each word, in the order of the file.
        starts: Fractional sample index (W,) of the first edge of bit 0 of each word.
    """

    samples: Array
    sample_rate: int
    labels: tuple[Timecode, ...]
    starts: Array


def word_bits(label: Timecode, user_bits: int = 0, balanced: bool = True) -> list[int]:
    """Return the 80 bits of a word in transmission order.

    Args:
        user_bits: 32 bits, user group 1 in the lowest four.
        balanced: Set the polarity bit so that the number of zeros is even.
    """
    bits = [0] * BITS
    fields = [
        (0, 4, label.frames % 10),
        (8, 2, label.frames // 10),
        (16, 4, label.seconds % 10),
        (24, 3, label.seconds // 10),
        (32, 4, label.minutes % 10),
        (40, 3, label.minutes // 10),
        (48, 4, label.hours % 10),
        (56, 2, label.hours // 10),
    ]
    fields += [(8 * group + 4, 4, (user_bits >> (4 * group)) & 15) for group in range(8)]
    for first, count, value in fields:
        for i in range(count):
            bits[first + i] = (value >> i) & 1
    bits[10] = int(label.rate.drop_frame)
    bits[64:] = SYNC_BITS
    if balanced and bits.count(0) % 2:
        bits[59 if label.rate.nominal == 25 else 27] = 1
    return bits


def encode_ltc(
    start: Timecode,
    words: int,
    sample_rate: int,
    *,
    lead: float = 0.0,
    tail: float = 0.0,
    speed: float = 1.0,
    user_bits: int = 0,
    amplitude: float = 0.25,
    inverted: bool = False,
    reverse: bool = False,
    balanced: bool = True,
) -> LtcSignal:
    """Return the audio of `words` words.

    Args:
        start: Label of the first word in the file. Later words count up, or down if `reverse`.
        lead, tail: Samples of silence before and after the signal. `lead` may be fractional.
        speed: Speed of the tape. A value of 1.01 plays one per cent too fast.
        amplitude: Peak as a share of full scale.
        inverted: Inverted polarity.

    Raises:
        UsageError: If there is nothing to encode.
    """
    if words < 1 or sample_rate < 1000 or speed <= 0.0:
        raise UsageError(f"cannot encode {words} words at {sample_rate} Hz and speed {speed}")
    cell = sample_rate / (float(start.rate.exact) * speed * BITS)
    labels, places = word_edges(start, words, user_bits=user_bits, reverse=reverse, balanced=balanced)
    edges = lead + cell * places
    count = int(np.ceil(edges[-1] + 0.5 * cell + tail)) + 1
    sigma = max(RISE_SECONDS * sample_rate / 2.563, BAND_LIMIT)
    samples = square_wave(edges, count, sigma, cell)
    starts = lead + BITS * cell * (np.arange(words) + (1.0 if reverse else 0.0))
    sign = -amplitude if inverted else amplitude
    return LtcSignal((sign * samples).astype(np.float32), sample_rate, tuple(labels), starts)


def word_edges(
    start: Timecode, words: int, *, user_bits: int = 0, reverse: bool = False, balanced: bool = True
) -> tuple[list[Timecode], Array]:
    """Return the labels of consecutive words and the positions of their edges in bit cells.

    The last edge ends the last bit.
    """
    step = -1 if reverse else 1
    labels = [Timecode.from_frame_count(start.frame_count + step * i, start.rate) for i in range(words)]
    bits = np.array([word_bits(label, user_bits, balanced)[::step] for label in labels]).ravel()
    both = np.column_stack([np.ones_like(bits), bits]).ravel()
    return labels, np.append(np.flatnonzero(both) * 0.5, float(len(bits)))


def square_wave(edges: Array, count: int, sigma: float, cell: float) -> Array:
    """Return a wave (`count`,) of +-1 that changes sign at the edges.

    It is silent before the first edge and from half a cell after the last. Edges are Gaussian steps.

    Args:
        edges: Fractional sample positions, increasing.
        sigma: Standard deviation of an edge, samples.
        cell: Samples per bit.
    """
    at = np.arange(count, dtype=np.float64)
    wave = np.zeros(count)
    reach = int(np.ceil(6.0 * sigma)) + 1
    inside = (at >= edges[0] - 0.5 * cell) & (at <= edges[-1] + 0.5 * cell)
    passed = np.searchsorted(edges, at)
    wave[inside] = np.where(passed[inside] % 2 == 0, -1.0, 1.0)
    for number, edge in enumerate(edges):
        near = np.arange(max(0, int(edge) - reach), min(count, int(edge) + reach + 2))
        near = near[inside[near]]
        sign = 1.0 if number % 2 == 0 else -1.0
        hard = np.where(near <= edge, -sign, sign)
        wave[near] += sign * erf((near - edge) / (np.sqrt(2.0) * sigma)) - hard
    return wave


@dataclass(frozen=True, kw_only=True)
class AudioFaults:
    """Faults of a line, a microphone or a sound card, all off by default.

    Args:
        snr_db: White noise over the whole band: rms of the signal relative to rms of the noise, dB.
        hum_db, hum_hz: Mains hum: rms relative to the rms of the signal in dB, and frequency in Hz.
        dc: Constant offset, as a share of full scale.
        gain_db, gain_hz: Amplitude (+- dB) and frequency of slow gain changes, as of an automatic gain
            control.
        clicks_per_s: Rate of short bursts with four times the peak.
        bits: Resolution of the recorder, which clips at full scale.
    """

    snr_db: float | None = None
    hum_db: float | None = None
    hum_hz: float = 50.0
    dc: float = 0.0
    gain_db: float = 0.0
    gain_hz: float = 0.5
    clicks_per_s: float = 0.0
    bits: int | None = None
    seed: int = 0


def degrade_audio(samples: Array, sample_rate: int, faults: AudioFaults) -> Array:
    """Return the samples (N,) float32 after the faults of a line."""
    rng = np.random.default_rng(faults.seed)
    time = np.arange(len(samples)) / sample_rate
    signal = samples.astype(np.float64)
    sounding = np.trim_zeros(signal)
    rms = float(np.sqrt(np.mean(sounding**2))) if len(sounding) else 1.0
    signal = signal * 10 ** (faults.gain_db / 20.0 * np.sin(2 * np.pi * faults.gain_hz * time))
    if faults.hum_db is not None:
        level = np.sqrt(2.0) * rms * 10 ** (faults.hum_db / 20.0)
        signal = signal + level * np.sin(2 * np.pi * faults.hum_hz * time + rng.uniform(0, 6.28))
    if faults.snr_db is not None:
        signal = signal + rms * 10 ** (-faults.snr_db / 20.0) * rng.standard_normal(len(signal))
    clicks = rng.poisson(faults.clicks_per_s * len(time) / sample_rate)
    for at in rng.integers(0, max(1, len(signal) - 8), clicks):
        signal[at : at + rng.integers(1, 8)] += 4.0 * np.abs(samples).max() * rng.choice([-1.0, 1.0])
    signal = signal + faults.dc
    if faults.bits is not None:
        scale = 2.0 ** (faults.bits - 1)
        signal = np.clip(np.round(signal * scale), -scale, scale - 1) / scale
    return signal.astype(np.float32)


def timecode_rate(name: str) -> FrameRate:
    """Return a frame rate by its usual name: 23.976, 24, 25, 29.97, 29.97df, 30.

    Raises:
        UsageError: For other names.
    """
    known = {
        "23.976": FrameRate(24, Fraction(24000, 1001)),
        "24": FrameRate(24, Fraction(24)),
        "25": FrameRate(25, Fraction(25)),
        "29.97": FrameRate(30, Fraction(30000, 1001)),
        "29.97df": FrameRate(30, Fraction(30000, 1001), True),
        "30": FrameRate(30, Fraction(30)),
    }
    if name not in known:
        raise UsageError(f"no timecode rate {name!r}; there are {', '.join(known)}")
    return known[name]
