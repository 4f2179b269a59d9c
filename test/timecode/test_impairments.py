"""Whatever a recording holds: no exception, usable deviations, no wrong label."""

from __future__ import annotations

import numpy as np
import pytest

from panoptic_ros.domain import Timecode, TimecodeReading
from panoptic_ros.errors import DataError
from panoptic_ros.simulation.ltc_signal import encode_ltc, timecode_rate
from panoptic_ros.study.timing.ltc_robustness import (
    CHANGES,
    ClipOutcome,
    Decode,
    ImpairedClip,
    impaired_clip,
    judged,
    live,
    outcome,
    recorded,
)

RATE = 48000
SEEDS = range(1000, 1016)  # of clips with one second of timecode; the bench has 300 of two


@pytest.mark.parametrize("seed", SEEDS)
def test_random_combinations_of_impairments(seed: int) -> None:
    clip = impaired_clip(seed, 1.0)
    found = outcome(clip, recorded if seed % 2 else live)
    assert (found.error, found.wrong, found.unusable) == ("", 0, 0), clip.kinds


def test_clips_are_the_same_each_time_and_differ_by_their_seed() -> None:
    first, again, other = (impaired_clip(seed, 0.5) for seed in (3, 3, 4))
    np.testing.assert_array_equal(first.samples, again.samples)
    assert first.kinds == again.kinds and first.kinds != other.kinds


def test_every_impairment_keeps_the_clip_and_its_truth_in_step() -> None:
    signal = encode_ltc(Timecode.from_frame_count(90, timecode_rate("25")), 20, RATE)
    lengths = np.full(20, RATE / 25.0)
    clean = ImpairedClip(signal.samples.astype(np.float64), RATE, signal.labels, signal.starts, lengths, ())
    for name, (_, change) in CHANGES.items():
        clip = change(clean, np.random.default_rng(1))
        assert np.isfinite(clip.samples).all() and len(clip.starts) == len(clip.labels) == 20, name


def _reading(label: Timecode, start: float, std: float = 0.1) -> TimecodeReading:
    return TimecodeReading("clip", 0, label, start, std, False, 0)


def test_what_counts_as_right_wrong_and_unusable() -> None:
    first, second, third = (Timecode.from_frame_count(n, timecode_rate("25")) for n in (10, 11, 12))
    starts, lengths = np.array([0.0, 1920.0]), np.full(2, 1920.0)
    clip = ImpairedClip(np.zeros(4000), RATE, (first, second), starts, lengths, (), faint=(third,))
    heard = [(first, 3.0), (second, 900.0), (third, 1920.0), (second, 1921.0)]
    readings = [_reading(label, start) for label, start in heard]
    assert judged(clip, readings) == ClipOutcome(sent=2, right=2, wrong=1)
    assert outcome(clip, lambda samples, rate: 1 / 0).error.startswith("ZeroDivisionError")


LTC = encode_ltc(Timecode.from_frame_count(1000, timecode_rate("25")), 25, RATE).samples


DEGENERATE = {
    "empty": np.zeros(0),
    "one sample": np.ones(1),
    "silence": np.zeros(RATE),
    "constant": np.ones(RATE),
    "negative": -np.ones(RATE),
    "huge": 1e30 * LTC,
    "tiny": 1e-20 * LTC[:20_000],
    "offset": LTC + 1e3,
}


@pytest.mark.parametrize("name", DEGENERATE)
@pytest.mark.parametrize("decode", [recorded, live])
def test_degenerate_recordings(name: str, decode: Decode) -> None:
    samples = DEGENERATE[name]
    for reading in decode(samples.astype(np.float32), RATE):
        assert np.isfinite(reading.std_samples) and reading.std_samples > 0.0


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("decode", [recorded, live])
def test_samples_that_are_not_finite_are_refused(value: float, decode: Decode) -> None:
    samples = LTC.copy()
    samples[30_000] = value
    with pytest.raises(DataError, match="not finite"):
        decode(samples, RATE)
