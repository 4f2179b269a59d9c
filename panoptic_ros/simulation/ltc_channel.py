"""Distortions of a timecode signal by tapes, lines, rooms and recorders, with the exact start of every word.

Edges are moved in continuous time (speed, wow, jitter) and drawn at four times the sample rate. Echoes and
filters act at that rate, and the recorder's low pass then reduces it to the sample rate. All filters except
the high pass and the echoes are symmetric, so edges keep their positions.
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
FINER = 4  # oversampling factor
RISE_SECONDS = 40e-6  # s; 10 to 90 % rise time of an edge
RECORDER_BAND = 0.46  # cut-off of the recorder's low pass, as a share of the sample rate
TAPS = 64  # length of the recorder's low pass in samples
RAMP_SECONDS = 5.0  # s; duration of a speed ramp


@dataclass(frozen=True, kw_only=True)
class ChannelDistortion:
    """Distortions of a channel, all off by default.

    Args:
        speed: Speed of the tape, 1 = nominal.
        ramp: Relative speed change within `RAMP_SECONDS`, up and then down again.
        wow, wow_hz: Relative depth and frequency of a sinusoidal speed error.
        flutter, flutter_hz: A second sinusoidal speed error, with a phase drawn from the seed.
        jitter_s: Standard deviation of single edges, s.
        low_pass_hz: Cut-off of a symmetric low pass, Hz.
        high_pass_hz: Cut-off of a first-order high pass, e.g. a coupling capacitor, Hz.
        echo_s: Time in which echoes decay by 60 dB, s.
        direct_db: Level of the direct sound relative to all echoes, dB.
        clip: Clipping level as a share of the peak, applied after noise.
        amplitude: Peak as a share of full scale.
        inverted: Inverted polarity.
        faults: Faults of the line and the recorder.
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
    channel: ChannelDistortion,
    *,
    lead: float = 0.25,
    user_bits: int = 0,
    reverse: bool = False,
) -> LtcSignal:
    """Return the audio of timecode words after a channel.

    Args:
        start: Label of the first word in the file. Later words count up, or down if `reverse`.
        words: Number of words.
        lead: Silence before the signal in s. The silence around the signal contains only what the line adds.

    Raises:
        UsageError: If there is nothing to play.
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


def _warped(times: Array, channel: ChannelDistortion) -> Array:
    """Return the actual times (s) of events with nominal times `times` (s), given the speed errors."""
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


def _in_the_room(wave: Array, rate: int, channel: ChannelDistortion, rng: np.random.Generator) -> Array:
    """Return the wave with echoes after the direct sound."""
    if not channel.echo_s:
        return wave
    time = np.arange(int(channel.echo_s * rate)) / rate
    echoes = rng.standard_normal(len(time)) * 10.0 ** (-3.0 * time / channel.echo_s)
    echoes[: int(0.002 * rate)] = 0.0
    echoes *= 10.0 ** (-channel.direct_db / 20.0) / np.linalg.norm(echoes)
    echoes[0] = 1.0
    return fftconvolve(wave, echoes)[: len(wave)]


def _recorded(wave: Array, sample_rate: int, channel: ChannelDistortion) -> Array:
    """Return the wave at `sample_rate`, after the low pass and the high pass of the recorder."""
    corner = RECORDER_BAND * sample_rate
    if channel.low_pass_hz:
        corner = min(corner, channel.low_pass_hz)
    taps = firwin(TAPS * FINER + 1, corner, window=("kaiser", 8.0), fs=sample_rate * FINER)
    wave = fftconvolve(wave, taps, mode="same")[::FINER]
    if channel.high_pass_hz:
        numerator, denominator = bilinear([1.0, 0.0], [1.0, 2.0 * np.pi * channel.high_pass_hz], sample_rate)
        wave = lfilter(numerator, denominator, wave)
    return wave
