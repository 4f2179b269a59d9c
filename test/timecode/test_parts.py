"""Words, cells and fits, each against an independent answer."""
from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from panoptic_ros.domain import Timecode
from panoptic_ros.simulation.ltc_signal import (
    AudioFaults,
    degrade_audio,
    encode_ltc,
    timecode_rate,
    word_bits,
)
from panoptic_ros.timecode.cells import decide_bits, even_parity, half_cells, integrate
from panoptic_ros.timecode.conditioning import Conditioner
from panoptic_ros.timecode.timing import fit_word
from panoptic_ros.timecode.words import parse_word, sync_matches


@settings(max_examples=100, deadline=None)
@given(
    st.integers(0, 2_589_407),
    st.sampled_from(["23.976", "24", "25", "29.97", "29.97df", "30"]),
    st.integers(0, 2**32 - 1),
    st.booleans(),
)
def test_words_are_read_back(count: int, rate: str, user: int, balanced: bool) -> None:
    label = Timecode.from_frame_count(count, timecode_rate(rate))
    read = parse_word(np.array(word_bits(label, user, balanced), np.int8))
    assert read is not None
    fields = (read.hours, read.minutes, read.seconds, read.frames, read.drop_frame, read.user_bits)
    assert fields == (label.hours, label.minutes, label.seconds, label.frames, label.rate.drop_frame, user)


@pytest.mark.parametrize(
    ("flip", "what"),
    [((64, 65), "sync"), ((3, 1), "frame units 12"), ((9, 8, 3), "frames 30"), ((26, 25), "seconds 62"),
     ((57, 56, 50), "hours 34")],
)  # fmt: skip
def test_broken_words_are_refused(flip: tuple[int, ...], what: str) -> None:
    label = Timecode(0, 0, 2, 0, timecode_rate("30"))
    bits = np.array(word_bits(label, balanced=False), np.int8)
    if what == "frame units 12":
        flip = (3, 2)
    bits[list(flip)] ^= 1
    assert parse_word(bits) is None, what


def test_dropped_labels_are_refused() -> None:
    bits = np.array(word_bits(Timecode(0, 1, 0, 2, timecode_rate("29.97df"))), np.int8)
    assert parse_word(bits) is not None
    bits[1] ^= 1  # 00:01:00;00
    assert parse_word(bits) is None


def test_sync_is_found_in_both_directions_and_nowhere_else() -> None:
    bits = np.array(word_bits(Timecode(23, 59, 59, 29, timecode_rate("30")), 0xFFFFFFFF), np.int8)
    stream = np.tile(bits, 3)
    assert list(np.flatnonzero(sync_matches(stream, False) == 16)) == [64, 144, 224]
    assert list(np.flatnonzero(sync_matches(stream[::-1], True) == 16)) == [0, 80, 160]
    assert not (sync_matches(stream, True) == 16).any()


@settings(max_examples=50, deadline=None)
@given(st.lists(st.floats(-1.0, 1.0), min_size=8, max_size=8), st.lists(st.floats(-0.4, 8.4), min_size=1))
def test_integrals_are_those_of_the_staircase(values: list[float], ends: list[float]) -> None:
    sums = np.concatenate([[0.0], np.cumsum(values)])
    fine = np.repeat(values, 1000)  # sample i covers i - 0.5 to i + 0.5
    for end in ends:
        expected = fine[: max(0, round((end + 0.5) * 1000))].sum() / 1000
        assert integrate(sums, np.array(end)) == pytest.approx(expected, abs=0.01)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.floats(-1.0, 1.0), min_size=12, max_size=12))
def test_bits_are_the_most_likely_ones(levels: list[float]) -> None:
    """Brute force over all words of six bits and both polarities."""

    def wave(bits: tuple[int, ...], sign: int) -> list[int]:
        halves = []
        for bit in bits:
            halves += [sign, -sign] if bit else [sign, sign]
            sign = sign if bit else -sign
        return halves

    words = itertools.product(itertools.product((0, 1), repeat=6), (1, -1))
    best = max(float(np.dot(levels, wave(bits, sign))) for bits, sign in words)
    found, quality = decide_bits(np.array(levels))
    total = float(np.abs(levels).sum())
    reached = max(float(np.dot(levels, wave(tuple(found), sign))) for sign in (1, -1))
    assert reached == pytest.approx(best, abs=1e-9)
    assert quality * total == pytest.approx(best, abs=1e-9)


def test_cells_of_a_clean_signal() -> None:
    signal = encode_ltc(Timecode.from_frame_count(777, timecode_rate("30")), 2, 48000, lead=50.5)
    sums = np.concatenate([[0.0], np.cumsum(signal.samples.astype(float))])
    halves = half_cells(sums, 50.5, 20.0, 160)
    bits, quality = decide_bits(halves)
    assert bits.tolist() == [bit for label in signal.labels for bit in word_bits(label)]
    assert quality > 0.999
    assert even_parity(halves) and not even_parity(halves[1:-1])


@pytest.mark.parametrize("rate", [8000, 16000, 44100, 48000, 96000])
def test_fit_of_a_clean_word_is_exact(rate: int) -> None:
    signal = encode_ltc(Timecode.from_frame_count(777, timecode_rate("25")), 3, rate, lead=33.3)
    bits = np.array(word_bits(signal.labels[1]))
    cell = rate / 2000
    raw = signal.samples.astype(float)
    fit = fit_word(raw, 0, bits, signal.starts[1] + 0.07 * cell, 1.0003 * cell, rate)
    assert fit is not None
    microseconds = 1e6 * (fit.middle - signal.starts[1] - 40 * cell) / rate
    assert abs(microseconds) < (3.0 if rate <= 16000 else 0.5)
    assert fit.cell == pytest.approx(cell, rel=1e-4)
    assert fit_word(raw, 0, bits, signal.starts[2] + 60 * cell, cell, rate) is None  # not all there


def test_fit_reaches_the_bound_of_cramer_and_rao() -> None:
    """var >= N0/2 sqrt(pi) s / (2 N A^2) for N Gaussian edges of standard deviation s."""
    rate, snr_db = 48000, 10.0
    signal = encode_ltc(Timecode.from_frame_count(777, timecode_rate("30")), 1, rate, lead=50.0, tail=50.0)
    bits = np.array(word_bits(signal.labels[0]))
    errors, stds = [], []
    for seed in range(60):
        raw = degrade_audio(signal.samples, rate, AudioFaults(snr_db=snr_db, seed=seed)).astype(float)
        fit = fit_word(raw, 0, bits, 50.4, 20.0, rate)
        assert fit is not None
        errors.append(fit.middle - 850.0)
        stds.append(fit.middle_std)
    edges, s, noise = 81 + bits.sum(), 15.6e-6 * rate, 10 ** (-snr_db / 20)
    bound = np.sqrt(noise**2 * np.sqrt(np.pi) * s / (2 * edges))
    assert np.std(errors) == pytest.approx(bound, rel=0.3)
    assert np.mean(stds) == pytest.approx(bound, rel=0.15)


def test_conditioning_removes_hum_and_keeps_edges_in_place() -> None:
    signal = encode_ltc(Timecode.from_frame_count(777, timecode_rate("25")), 10, 48000).samples
    bad = degrade_audio(signal, 48000, AudioFaults(hum_db=6.0, dc=0.3, clicks_per_s=20.0))
    conditioner = Conditioner(48000, 350.0)
    parts = [conditioner.push(part.astype(float)) for part in np.array_split(bad, 7)]
    clean = np.concatenate([*parts, conditioner.push(np.zeros(conditioner.reach))])
    assert len(clean) == len(signal)
    inner = slice(2000, -2000)
    assert np.corrcoef(clean[inner], signal[inner])[0, 1] > 0.95
    assert np.abs(clean).max() < 0.7
