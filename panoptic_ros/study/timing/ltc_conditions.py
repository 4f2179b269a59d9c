"""Conditions of the timecode benchmark: noise, and the impairments of lines, tapes and rooms."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from panoptic_ros.domain import FrameRate, Timecode
from panoptic_ros.simulation.ltc_channel import ChannelDistortion, play_ltc
from panoptic_ros.simulation.ltc_signal import AudioFaults, LtcSignal, timecode_rate

FAULTS = set(AudioFaults.__dataclass_fields__)
QUIET_DB = 50.0  # signal-to-noise ratio of conditions without a noise level, dB


@dataclass(frozen=True, slots=True)
class Condition:
    """One row of the table.

    Args:
        changes: fields of `ChannelDistortion` and `AudioFaults`.
        rate: frame rate; clips alternate between several.
        reverse: play the words in reverse.
    """

    name: str
    sample_rate: int
    changes: dict[str, Any] = field(default_factory=dict)
    rate: str | tuple[str, ...] = "30"
    reverse: bool = False

    def rate_of(self, seed: int) -> FrameRate:
        """Return the frame rate of the clip with this seed."""
        names = (self.rate,) if isinstance(self.rate, str) else self.rate
        return timecode_rate(names[seed % len(names)])


def clip(condition: Condition, seed: int, words: int) -> LtcSignal:
    """Return a clip; the seed sets labels, user bits, phase and a drift of up to 40 ppm."""
    rng = np.random.default_rng([seed, condition.sample_rate])
    changes = {"snr_db": QUIET_DB, **condition.changes}
    faults = {key: value for key, value in changes.items() if key in FAULTS}
    rest = {key: value for key, value in changes.items() if key not in FAULTS}
    speed = rest.pop("speed", 1.0) * (1.0 + 4e-5 * rng.uniform(-1.0, 1.0))
    channel = ChannelDistortion(speed=speed, seed=seed, faults=AudioFaults(seed=seed, **faults), **rest)
    rate = condition.rate_of(seed)
    start = Timecode.from_frame_count(int(rng.integers(0, 2_000_000)), rate)
    lead = 0.5 + rng.uniform(0.0, 1.0) / condition.sample_rate
    user = int(rng.integers(0, 2**32))
    return play_ltc(
        start, words, condition.sample_rate, channel, lead=lead, user_bits=user, reverse=condition.reverse
    )


def noise_bound_us(condition: Condition) -> float:
    """Return the Cramer-Rao bound (us) of a word's start.

    It is NaN for conditions with anything but white noise.
    """
    if set(condition.changes) != {"snr_db"}:
        return float("nan")
    rate = condition.sample_rate
    start = Timecode.from_frame_count(1_234_567, condition.rate_of(0))
    step, words = 0.02, 5
    early, late = (
        play_ltc(start, words, rate, ChannelDistortion(), lead=(9600 + shift) / rate)
        for shift in (-0.5 * step, 0.5 * step)
    )
    count = min(len(late.samples), len(early.samples))
    slope = (late.samples[:count].astype(float) - early.samples[:count]) / step
    inside = slice(int(early.starts[0]), int(early.starts[0] + words * (early.starts[1] - early.starts[0])))
    rms = float(np.sqrt(np.mean(early.samples[inside].astype(float) ** 2)))
    noise = rms * 10.0 ** (-condition.changes["snr_db"] / 20.0)
    deviation: float = 1e6 * noise / rate / float(np.sqrt((slope**2).sum() / words))
    return deviation


def _table() -> tuple[Condition, ...]:
    noise = [
        Condition(f"{rate // 1000} kHz, noise {snr:+d} dB", rate, {"snr_db": float(snr)})
        for rate, ratios in ((48000, (30, 20, 10, 0, -3, -6)), (16000, (30, 20, 10, 0, -3)))
        for snr in ratios
    ]
    names = ("23.976", "24", "25", "29.97", "29.97df")
    counting = [Condition(f"{name} frames/s", 48000, {}, rate=name) for name in names]
    sampling = [Condition(f"{rate} Hz sampling", rate) for rate in (8000, 22050, 44100, 96000)]
    impaired = [
        Condition(name, rate, changes, reverse="reverse" in name) for name, rate, changes in IMPAIRMENTS
    ]
    return (*noise, *counting, *sampling, *impaired, *_fluttering())


def _fluttering() -> Iterator[Condition]:
    """Yield conditions with speed variation at one or two frequencies.

    Most vary by 0.5 %. Slight ones vary by 0.02 %, so that the words lie nearly on a line.
    """
    for rate in (48000, 16000):
        for swings in FLUTTERS:
            changes = {"snr_db": FLUTTER_DB, "flutter": FLUTTER, "flutter_hz": swings[-1]}
            if len(swings) > 1:
                changes |= {"wow": FLUTTER, "wow_hz": swings[0]}
            name = f"{rate // 1000} kHz, flutter {' + '.join(f'{hz:g}' for hz in swings)} Hz"
            yield Condition(name, rate, changes, FLUTTER_RATES)
        for hz in (0.5, 1.0, 3.0):
            changes = {"snr_db": FLUTTER_DB, "flutter": SLIGHT, "flutter_hz": hz}
            yield Condition(f"{rate // 1000} kHz, slight flutter {hz:g} Hz", rate, changes, FLUTTER_RATES)


FLUTTER, SLIGHT, FLUTTER_DB = 0.005, 0.0002, 18.0
FLUTTERS = (
    (0.5,),
    (1.0,),
    (3.0,),
    (9.0,),
    (15.0,),
    (30.0,),
    (0.5, 9.0),
    (0.5, 30.0),
    (1.0, 15.0),
    (3.0, 9.0),
    (3.0, 30.0),
    (9.0, 30.0),
)
FLUTTER_RATES = ("24", "25", "29.97df", "30")
MICROPHONE = {"low_pass_hz": 7000.0, "high_pass_hz": 100.0, "snr_db": 20.0, "echo_s": 0.2, "direct_db": 12.0}
IMPAIRMENTS: tuple[tuple[str, int, dict[str, Any]], ...] = (
    ("hum 0 dB", 48000, {"hum_db": 0.0}),
    ("hum 0 dB, 16 kHz", 16000, {"hum_db": 0.0}),
    ("hum of 60 Hz, 0 dB", 48000, {"hum_db": 0.0, "hum_hz": 60.0}),
    ("clicks 10/s", 48000, {"clicks_per_s": 10.0}),
    ("clicks 30/s", 48000, {"clicks_per_s": 30.0}),
    ("clicks 10/s, 16 kHz", 16000, {"clicks_per_s": 10.0}),
    ("clicks 30/s, 16 kHz", 16000, {"clicks_per_s": 30.0}),
    ("gain +-10 dB at 0.5 Hz", 48000, {"gain_db": 10.0}),
    ("gain +-10 dB at 5 Hz", 48000, {"gain_db": 10.0, "gain_hz": 5.0}),
    ("DC of the peak", 48000, {"dc": 0.25}),
    ("-60 dBFS in 16 bit", 48000, {"amplitude": 0.001, "bits": 16, "snr_db": 40.0}),
    ("8 bit", 48000, {"bits": 8}),
    ("inverted", 48000, {"inverted": True}),
    ("speed 0.8", 48000, {"speed": 0.8}),
    ("speed 1.25", 48000, {"speed": 1.25}),
    ("speed 0.8, 16 kHz", 16000, {"speed": 0.8}),
    ("speed 1.25, 16 kHz", 16000, {"speed": 1.25}),
    ("reverb 8 dB", 48000, {"echo_s": 0.3, "direct_db": 8.0}),
    ("reverb 3 dB", 48000, {"echo_s": 0.5, "direct_db": 3.0}),
    ("high pass 1 kHz", 48000, {"high_pass_hz": 1000.0}),
    ("low pass 4 kHz", 48000, {"low_pass_hz": 4000.0}),
    ("low pass 2.5 kHz", 48000, {"low_pass_hz": 2500.0}),
    ("clipped at 0.8", 48000, {"clip": 0.8}),
    ("clipped at 0.5", 48000, {"clip": 0.5}),
    ("clipped at 0.2, noise 20 dB", 48000, {"clip": 0.2, "snr_db": 20.0}),
    ("reverse", 48000, {}),
    ("reverse, noise 0 dB", 48000, {"snr_db": 0.0}),
    ("microphone, 16 kHz", 16000, MICROPHONE),
    ("wow 3 % at 0.5 Hz", 48000, {"wow": 0.03, "wow_hz": 0.5}),
    ("wow 3 % at 3 Hz", 48000, {"wow": 0.03, "wow_hz": 3.0}),
    ("ramp 30 %", 48000, {"ramp": 0.3}),
    ("edge jitter 5 us", 48000, {"jitter_s": 5e-6}),
)
CONDITIONS = _table()
