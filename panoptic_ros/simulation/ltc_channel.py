"""What tapes, lines, rooms and recorders do to a timecode signal, with the exact start of every word.

Edges are moved in continuous time (speed, wow, jitter), drawn at four times the sample rate, taken through
echoes and filters there, and through the recorder's low pass to the sample rate. All filters but the
high pass and the echoes are symmetric, so edges stay where they are.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.signal import bilinear, fftconvolve, firwin, lfilter

from panoptic_ros.domain import Timecode
from panoptic_ros.errors import UsageError
from panoptic_ros.simulation.ltc_signal import (
    BITS,
    AudioFaults,
    LtcSignal,
    degrade_audio,
    square_wave,
    word_edges,
)

Array = np.ndarray
FINER = 4
RISE_SECONDS = 40e-6
RECORDER_BAND = 0.46  # of the sample rate
TAPS = 64  # samples of the recorder's filter
RAMP_SECONDS = 5.0


@dataclass(frozen=True, kw_only=True)
class Channel:
    """All off by default.

    Args:
        speed: of the tape.
        ramp: by which the speed changes in `RAMP_SECONDS`, up and then down again.
        wow, wow_hz: depth and rate of a swinging speed.
        flutter, flutter_hz: the same once more, with a phase by the seed.
        jitter_s: standard deviation of single edges.
        low_pass_hz, high_pass_hz: symmetric; first order, as a coupling capacitor.
        echo_s, direct_db: time in which echoes fall by 60 dB; the direct sound against all echoes.
        clip: of the peak, after noise.
        amplitude: peak, of full scale.
        inverted: the other polarity.
        faults: of the line and the recorder.
    """

    speed: float = 1.0
    ramp: float = 0.0
    wow: float = 0.0
    wow_hz: float = 0.5
    flutter: float = 0.0
    flutter_hz: float = 9.0
    jitter_s: float = 0.0
    low_pass_hz: float = 0.0
    high_pass_hz: float = 0.0
    echo_s: float = 0.0
    direct_db: float = 0.0
    clip: float = 0.0
    amplitude: float = 0.25
    inverted: bool = False
    faults: AudioFaults = field(default_factory=AudioFaults)
    seed: int = 0


def play_ltc(
    start: Timecode,
    words: int,
    sample_rate: int,
    channel: Channel,
    *,
    lead: float = 0.25,
    user_bits: int = 0,
    reverse: bool = False,
) -> LtcSignal:
    """Audio of words as it arrives through a channel.

    Args:
        start: label of the first word in the file; later ones count up, or down if `reverse`.
        lead: s of silence before; there and after is what the line adds.

    Raises:
        UsageError: if there is nothing to play.
    """
    if words < 1 or sample_rate < 1000 or channel.speed <= 0.0:
        raise UsageError(f"cannot play {words} words at {sample_rate} Hz and speed {channel.speed}")
    rng = np.random.default_rng(channel.seed)
    labels, edges = word_edges(start, words, user_bits=user_bits, reverse=reverse)
    cell = 1.0 / (float(start.rate.exact) * channel.speed * BITS)
    bounds = np.arange(words) * BITS + (BITS if reverse else 0)
    starts = lead + _warped(bounds * cell, channel)
    times = lead + _warped(edges * cell, channel)
    times += channel.jitter_s * rng.standard_normal(len(times))
    rate = sample_rate * FINER
    count = int(np.ceil((times[-1] + 0.1) * sample_rate)) * FINER
    fine = square_wave(times * rate, count, RISE_SECONDS * rate / 2.563, cell * rate)
    wave = _recorded(_in_the_room(fine, rate, channel, rng), sample_rate, channel)
    wave = channel.amplitude * (-wave if channel.inverted else wave)
    samples = degrade_audio(wave.astype(np.float32), sample_rate, channel.faults)
    if channel.clip:
        limit = channel.clip * channel.amplitude
        samples = np.clip(samples, -limit, limit)
    return LtcSignal(samples.astype(np.float32), sample_rate, tuple(labels), starts * sample_rate)


def _warped(times: Array, channel: Channel) -> Array:
    """When what should come at some times comes."""
    warped = times
    if channel.ramp:
        swing = np.pi / RAMP_SECONDS
        warped = warped + channel.ramp * 0.5 * (np.sin(swing * times) / swing)
    if channel.wow:
        swing = 2.0 * np.pi * channel.wow_hz
        warped = warped + channel.wow / swing * np.sin(swing * times)
    if channel.flutter:
        swing = 2.0 * np.pi * channel.flutter_hz
        phase = np.random.default_rng([channel.seed, 1]).uniform(0.0, 2.0 * np.pi)
        warped = warped + channel.flutter / swing * np.sin(swing * times + phase)
    return warped


def _in_the_room(wave: Array, rate: int, channel: Channel, rng: np.random.Generator) -> Array:
    """Echoes after the direct sound."""
    if not channel.echo_s:
        return wave
    time = np.arange(int(channel.echo_s * rate)) / rate
    echoes = rng.standard_normal(len(time)) * 10.0 ** (-3.0 * time / channel.echo_s)
    echoes[: int(0.002 * rate)] = 0.0
    echoes *= 10.0 ** (-channel.direct_db / 20.0) / np.linalg.norm(echoes)
    echoes[0] = 1.0
    return fftconvolve(wave, echoes)[: len(wave)]


def _recorded(wave: Array, sample_rate: int, channel: Channel) -> Array:
    """At the sample rate, through the low pass and the coupling."""
    corner = RECORDER_BAND * sample_rate
    if channel.low_pass_hz:
        corner = min(corner, channel.low_pass_hz)
    taps = firwin(TAPS * FINER + 1, corner, window=("kaiser", 8.0), fs=sample_rate * FINER)
    wave = fftconvolve(wave, taps, mode="same")[::FINER]
    if channel.high_pass_hz:
        numerator, denominator = bilinear([1.0, 0.0], [1.0, 2.0 * np.pi * channel.high_pass_hz], sample_rate)
        wave = lfilter(numerator, denominator, wave)
    return wave
