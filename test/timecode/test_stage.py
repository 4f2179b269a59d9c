"""Encode, degrade, decode: what comes out is the truth, or nothing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from panoptic_ros.domain import AudioBlock, Timecode, TimecodeReading
from panoptic_ros.errors import DataError
from panoptic_ros.simulation.ltc_signal import (
    AudioFaults,
    LtcSignal,
    degrade_audio,
    encode_ltc,
    timecode_rate,
)
from panoptic_ros.timecode.config import TimecodeConfig
from panoptic_ros.timecode.stage import TimecodeStage

RATES = ["23.976", "24", "25", "29.97", "29.97df", "30"]


def blocks(samples: np.ndarray, rate: int, size: int = 1024, device: str = "mic") -> list[AudioBlock]:
    return [
        AudioBlock(device, 10**9 + first * 10**9 // rate, first, rate, samples[first : first + size])
        for first in range(0, len(samples), size)
    ]


def decode(items: Sequence[AudioBlock]) -> list[TimecodeReading]:
    stage = TimecodeStage(TimecodeConfig())
    readings = [reading for item in items for reading in stage.step(item).outputs]
    return readings + list(stage.flush().outputs)


def check(
    signal: LtcSignal, readings: Sequence[TimecodeReading], missing: int = 0, within_us: float = 5.0
) -> None:
    """All labels but `missing` were read, none is wrong, and the starts are right."""
    truth = {str(label): start for label, start in zip(signal.labels, signal.starts)}
    assert {str(reading.timecode) for reading in readings} <= set(truth)
    errors = [1e6 * (r.start_sample - truth[str(r.timecode)]) / signal.sample_rate for r in readings]
    assert len(readings) >= len(signal.labels) - missing
    assert np.abs(errors).max() < within_us


def make(rate: str, words: int, sample_rate: int, count: int = 107_890, **more: float) -> LtcSignal:
    return encode_ltc(Timecode.from_frame_count(count, timecode_rate(rate)), words, sample_rate, **more)


@pytest.mark.parametrize("rate", RATES)
def test_every_rate_is_read_and_recognised(rate: str) -> None:
    signal = make(rate, 40, 48000, lead=321.7, tail=200, user_bits=0x12345678)
    readings = decode(blocks(signal.samples, 48000))
    check(signal, readings, within_us=0.5)
    assert readings[-1].timecode == signal.labels[-1]  # with rate and drop-frame
    assert {reading.user_bits for reading in readings} == {0x12345678}
    for reading in readings:
        assert reading.stamp_ns == pytest.approx(10**9 + reading.start_sample / 48000 * 1e9, abs=2)


@pytest.mark.parametrize("sample_rate", [8000, 11025, 16000, 22050, 44100, 96000])
def test_every_sample_rate(sample_rate: int) -> None:
    signal = make("30", 30, sample_rate, lead=100.5, tail=50)
    check(signal, decode(blocks(signal.samples, sample_rate)))


@settings(max_examples=15, deadline=None)
@given(
    rate=st.sampled_from(RATES),
    count=st.integers(0, 2_000_000),
    sample_rate=st.sampled_from([16000, 44100, 48000]),
    user_bits=st.integers(0, 2**32 - 1),
    inverted=st.booleans(),
    balanced=st.booleans(),
    reverse=st.booleans(),
    speed=st.floats(0.8, 1.25),
    lead=st.floats(0.0, 3000.0),
    faults=st.builds(
        AudioFaults,
        snr_db=st.floats(10.0, 40.0),
        hum_db=st.none() | st.floats(-20.0, 6.0),
        dc=st.floats(-0.3, 0.3),
        gain_db=st.floats(0.0, 10.0),
        seed=st.integers(0, 99),
    ),
)
def test_what_is_decoded_from_a_bad_line_is_the_truth(
    rate: str,
    count: int,
    sample_rate: int,
    user_bits: int,
    inverted: bool,
    balanced: bool,
    reverse: bool,
    speed: float,
    lead: float,
    faults: AudioFaults,
) -> None:
    signal = make(
        rate,
        25,
        sample_rate,
        count,
        lead=lead,
        tail=300,
        speed=speed,
        user_bits=user_bits,
        inverted=inverted,
        balanced=balanced,
        reverse=reverse,
    )
    bad = degrade_audio(signal.samples, sample_rate, faults)
    readings = decode(blocks(bad, sample_rate))
    check(signal, readings, missing=3, within_us=12.0)
    assert all(reading.reverse == reverse and reading.user_bits == user_bits for reading in readings)


@pytest.mark.parametrize(
    "faults",
    [
        AudioFaults(hum_db=0.0),
        AudioFaults(dc=0.25),
        AudioFaults(gain_db=10.0, gain_hz=5.0),
        AudioFaults(bits=8),
        AudioFaults(snr_db=6.0),
        AudioFaults(clicks_per_s=30.0),
    ],
)
def test_single_faults(faults: AudioFaults) -> None:
    signal = make("25", 50, 48000, lead=500, tail=100)
    bad = degrade_audio(signal.samples, 48000, faults)
    check(signal, decode(blocks(bad, 48000)), missing=3, within_us=10.0)


@pytest.mark.parametrize(
    ("sample_rate", "snr_db"), [(48000, -3.0), (48000, -6.0), (16000, 0.0), (16000, -3.0)]
)
def test_words_that_nobody_could_read_alone(sample_rate: int, snr_db: float) -> None:
    signal = make("30", 90, sample_rate, lead=sample_rate / 3, tail=100, user_bits=0x26110721)
    bad = degrade_audio(signal.samples, sample_rate, AudioFaults(snr_db=snr_db))
    readings = decode(blocks(bad, sample_rate))
    check(signal, readings, missing=1, within_us=40.0)
    assert {reading.user_bits for reading in readings} == {0x26110721}


def test_many_clicks_at_a_low_rate() -> None:
    signal = make("30", 150, 16000, lead=500, tail=100)
    bad = degrade_audio(signal.samples, 16000, AudioFaults(clicks_per_s=60.0))
    check(signal, decode(blocks(bad, 16000)), missing=4)


@pytest.mark.parametrize(("depth", "hz"), [(0.03, 0.5), (0.03, 3.0)])
def test_wow(depth: float, hz: float) -> None:
    """Samples taken at a speed that swings."""
    signal = make("30", 90, 48000, tail=4000)
    at = np.arange(len(signal.samples) - 3000.0)
    swing = 2 * np.pi * hz / 48000
    place = at + 1000.0 + depth / swing * np.sin(swing * at)
    samples = np.interp(place, np.arange(len(signal.samples)), signal.samples).astype(np.float32)
    starts = np.interp(signal.starts, place, at)
    moved = LtcSignal(samples, 48000, signal.labels, starts)
    check(moved, decode(blocks(samples, 48000)), missing=7, within_us=10.0)


def test_stated_deviations_are_those_of_the_errors() -> None:
    signal = make("30", 150, 48000, lead=321.7, tail=200)
    readings = decode(blocks(degrade_audio(signal.samples, 48000, AudioFaults(snr_db=15.0)), 48000))
    truth = {str(label): start for label, start in zip(signal.labels, signal.starts)}
    ratio = [(r.start_sample - truth[str(r.timecode)]) / r.std_samples for r in readings]
    assert 0.6 < np.std(ratio) < 1.4


@pytest.mark.parametrize("size", [1, 37, 480, 100_000])
def test_the_size_of_blocks_does_not_matter(size: int) -> None:
    signal = make("25", 16, 8000, lead=70.0, tail=40)
    bad = degrade_audio(signal.samples, 8000, AudioFaults(snr_db=20.0))
    first, other = decode(blocks(bad, 8000)), decode(blocks(bad, 8000, size))
    assert [(r.timecode, r.start_sample, r.std_samples) for r in first] == [
        (r.timecode, r.start_sample, r.std_samples) for r in other
    ]
    assert len(first) == 16


def test_readings_come_soon_after_their_word() -> None:
    signal = make("25", 75, 48000)
    stage = TimecodeStage(TimecodeConfig())
    for item in blocks(signal.samples, 48000, 480):
        for reading in stage.step(item).outputs:
            late = (item.first_sample + 480 - reading.start_sample) / 48000
            assert late < (0.2 if reading.start_sample > 48000 else 0.8)


def test_noise_has_no_timecode() -> None:
    rng = np.random.default_rng(0)
    assert decode(blocks(rng.normal(0, 0.1, 200_000).astype(np.float32), 48000)) == []
    assert decode(blocks(np.zeros(200_000, np.float32), 48000)) == []
    tone = np.sign(np.sin(2 * np.pi * 1000.0 * np.arange(100_000) / 48000)).astype(np.float32)
    assert decode(blocks(tone, 48000)) == []


def test_random_biphase_data_without_sync_has_no_timecode() -> None:
    rng = np.random.default_rng(1)
    halves, sign = [], 1.0
    for bit in rng.integers(0, 2, 6000):
        halves += [sign, -sign] if bit else [sign, sign]
        sign = sign if bit else -sign
    assert decode(blocks(0.3 * np.repeat(halves, 12).astype(np.float32), 48000)) == []


def test_recovers_after_loud_noise_and_silence() -> None:
    signal = make("30", 60, 48000)
    rng = np.random.default_rng(2)
    noise = rng.normal(0, 0.8, 48000).astype(np.float32)
    joined = np.concatenate([noise, signal.samples, np.zeros(30_000, np.float32), noise, signal.samples])
    readings = decode(blocks(joined, 48000))
    labels = [str(reading.timecode) for reading in readings]
    assert set(labels) <= {str(label) for label in signal.labels}
    assert len(labels) >= 2 * 60 - 4


def test_a_cut_word_is_not_reported() -> None:
    signal = make("25", 20, 48000)
    cut = signal.samples.copy()
    cut[int(signal.starts[12] + 1000) :] = 0.0
    readings = decode(blocks(cut, 48000))
    assert [reading.timecode for reading in readings] == list(signal.labels[:12])


def test_lost_blocks_are_noticed_and_do_no_harm() -> None:
    signal = make("25", 100, 48000)
    items = blocks(signal.samples, 48000)
    del items[40:43]
    stage = TimecodeStage(TimecodeConfig())
    results = [stage.step(item) for item in items]
    readings = [reading for result in results for reading in result.outputs] + list(stage.flush().outputs)
    check(signal, readings, missing=5)
    (notice,) = [notice for result in results for notice in result.notices]
    assert notice.code == "timecode.gap" and "lost 3072 samples before sample 44032" in notice.text


@pytest.mark.parametrize(("size", "lost"), [(480, 1), (1024, 1), (1024, 5), (4096, 3)])
@pytest.mark.parametrize("late_s", [0.0, 2e-3])
def test_lost_blocks_that_nobody_counts_are_told(size: int, lost: int, late_s: float) -> None:
    """Labels and stamps agree against the count of samples."""
    rng = np.random.default_rng(size)
    signal = make("29.97", 120, 48000)
    items = blocks(signal.samples, 48000, size)
    del items[20 : 20 + lost]
    stage, readings, notices, counted = TimecodeStage(TimecodeConfig()), [], [], 0
    for item in items:
        late = round(1e9 * late_s * rng.random())
        result = stage.step(replace(item, first_sample=counted, stamp_ns=item.stamp_ns + late))
        counted += len(item.samples)
        readings += result.outputs
        notices += result.notices
    assert len(readings) > 100 and {str(r.timecode) for r in readings} <= {str(x) for x in signal.labels}
    (notice,) = notices
    assert notice.code == "timecode.gap" and f"lost about {size * lost} samples" in notice.text


def test_a_jump_of_the_labels_is_reported_once() -> None:
    first, second = make("25", 40, 48000), make("25", 40, 48000, 500)
    joined = np.concatenate([first.samples[: int(first.starts[-1] + 1920)], second.samples])
    stage = TimecodeStage(TimecodeConfig())
    results = [stage.step(item) for item in blocks(joined, 48000)]
    readings = [reading for result in results for reading in result.outputs] + list(stage.flush().outputs)
    assert [reading.timecode for reading in readings] == [*first.labels, *second.labels]
    codes = [notice.code for result in results for notice in result.notices]
    assert codes == ["timecode.jump"]


@pytest.mark.parametrize("frames", [4, 5, 12])
def test_timecode_that_stands_still_is_not_read_on(frames: int) -> None:
    """The next label differs in bit 0 only, in two bits, in three; grids slip along with the words."""
    signal = make("24", 12, 16000, count=24 * 3600 + frames - 11, lead=300.0)
    last, end = int(signal.starts[-1]), int(2 * signal.starts[-1] - signal.starts[-2])
    repeated = [signal.samples[last:end]] * 12
    readings = decode(blocks(np.concatenate([signal.samples[:end], *repeated]), 16000))
    assert len(readings) >= 12
    assert {str(reading.timecode) for reading in readings} <= {str(label) for label in signal.labels}


def test_midnight() -> None:
    signal = make("29.97df", 40, 48000, 24 * 107_892 - 20)
    readings = decode(blocks(signal.samples, 48000))
    assert [str(reading.timecode) for reading in readings][19:21] == ["23:59:59;29", "00:00:00;00"]


def test_devices_do_not_mix() -> None:
    one, two = make("25", 40, 48000), make("30", 40, 16000, 3000, user_bits=7)
    first, second = blocks(one.samples, 48000), blocks(two.samples, 16000, device="kinect")
    stage = TimecodeStage(TimecodeConfig())
    readings = []
    for k in range(max(len(first), len(second))):
        for items in (first, second):
            if k < len(items):
                readings += stage.step(items[k]).outputs
    readings += stage.flush().outputs
    assert [r.timecode for r in readings if r.device == "mic"] == list(one.labels)
    assert [r.timecode for r in readings if r.device == "kinect"] == list(two.labels)


def test_reset_and_flush_leave_a_new_stage() -> None:
    signal = make("25", 20, 16000)
    items = blocks(signal.samples, 16000)
    stage = TimecodeStage(TimecodeConfig())

    def play() -> list[tuple[str, float]]:
        out = [r for item in items for r in stage.step(item).outputs] + list(stage.flush().outputs)
        return [(str(r.timecode), r.start_sample) for r in out]

    first = play()
    assert len(first) == 20 and play() == first
    stage.step(items[0])
    stage.reset()
    assert play() == first


# ---------------------------------------------------------------- several channels


def stereo(left: LtcSignal, right: LtcSignal, clocks: tuple[str, ...] = ()) -> list[AudioBlock]:
    """Two signals side by side in blocks of one device."""
    count = min(len(left.samples), len(right.samples))
    both = np.stack([left.samples[:count], right.samples[:count]], axis=1)
    items = blocks(both, left.sample_rate)
    return [replace(item, clocks=clocks) for item in items]


def by_clock(readings: Sequence[TimecodeReading]) -> dict[str, list[TimecodeReading]]:
    return {clock: [r for r in readings if r.clock == clock] for clock in {r.clock for r in readings}}


def test_each_channel_that_is_named_is_read_for_its_clock() -> None:
    left, right = make("25", 60, 48000), make("29.97", 72, 48000, 40_000, lead=333.3)
    alone = [decode(blocks(signal.samples, 48000)) for signal in (left, right)]
    found = by_clock(decode(stereo(left, right, ("A", "B"))))
    assert set(found) == {"A", "B"}
    check(left, found["A"], 1)
    check(right, found["B"], 1)
    for clock, own in zip("AB", alone):
        assert [r.start_sample for r in found[clock]] == [r.start_sample for r in own][: len(found[clock])]
        assert {r.sample_rate for r in found[clock]} == {48000}


def test_a_channel_without_a_clock_is_not_read_and_the_parameter_goes_before_the_sound() -> None:
    left, right = make("25", 40, 48000), make("29.97", 48, 48000, 40_000)
    assert set(by_clock(decode(stereo(left, right, ("", "B"))))) == {"B"}
    stage = TimecodeStage(TimecodeConfig(channels=("mic=X,",)))
    readings = [r for item in stereo(left, right, ("A", "B")) for r in stage.step(item).outputs]
    assert set(by_clock(readings)) == {"X"}
    with pytest.raises(DataError, match=r"names 2 channels of mic \(X, \), but its sound has 1"):
        stage.step(blocks(left.samples, 48000)[0])


def test_where_nobody_names_channels_one_counts_and_others_are_told_once() -> None:
    left, right = make("25", 40, 48000, lead=9000.0), make("29.97", 48, 48000, 40_000)
    stage = TimecodeStage(TimecodeConfig())
    results = [stage.step(item) for item in stereo(left, right)]
    readings = [r for result in results for r in result.outputs]
    assert {(r.clock, r.timecode.rate.nominal) for r in readings} == {("", 30)}  # the first that is heard
    told = [n for result in results for n in result.notices]
    assert [n.code for n in told] == ["timecode.several"]
    assert "channels 1 and 0; that of 1 counts" in told[0].text


def test_one_timecode_on_both_channels_is_no_news() -> None:
    signal = make("25", 40, 48000, lead=9000.0)
    noisy = replace(signal, samples=signal.samples + 0.01 * np.sin(np.arange(len(signal.samples))))
    stage = TimecodeStage(TimecodeConfig())
    results = [stage.step(item) for item in stereo(signal, noisy)]
    assert not [notice for result in results for notice in result.notices]
    assert sum(len(result.outputs) for result in results) > 30


def test_a_channel_named_as_its_device_tells_of_the_clock_of_the_device() -> None:
    signal = make("25", 40, 48000)
    items = [replace(item, clocks=("mic",)) for item in blocks(signal.samples, 48000)]
    assert set(by_clock(decode(items))) == {""}
