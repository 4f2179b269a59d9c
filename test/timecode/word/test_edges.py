"""Starts of words and their deviations by least squares of edges, against the truth."""

from __future__ import annotations

import numpy as np
import pytest

from panoptic_ros.domain import Timecode
from panoptic_ros.simulation.ltc_signal import (
    AudioFaults,
    degrade_audio,
    encode_ltc,
    timecode_rate,
    word_bits,
)
from panoptic_ros.timecode.word.edges import EVEN, SWINGING, EdgeFit, fit_edges
from panoptic_ros.timecode.word.tracking import BETWEEN

LEVEL = 0.25
FIRST, CELL = 50.4, 20.0  # samples, of a word of 30 frames/s at 48 kHz
LINE = FIRST + CELL * (40.0 + BETWEEN)


def one_word(**faults: float) -> tuple[np.ndarray, np.ndarray]:
    """Samples of a word that begins at `FIRST`, and the signs (160,) of its half cells."""
    signal = encode_ltc(Timecode.from_frame_count(777, timecode_rate("30")), 1, 48000, lead=FIRST, tail=50)
    sign, signs = float(np.sign(signal.samples[int(FIRST) + 5])), []
    for bit in word_bits(signal.labels[0]):
        signs += [sign, -sign] if bit else [sign, sign]
        sign = sign if bit else -sign
    samples = degrade_audio(signal.samples, 48000, AudioFaults(**faults)) if faults else signal.samples
    return samples.astype(float), np.array(signs, np.int8)


def fit(samples: np.ndarray, signs: np.ndarray, guess: np.ndarray, terms: int = EVEN) -> EdgeFit:
    return fit_edges(np.concatenate([[0.0], np.cumsum(samples)]), guess, signs, LEVEL, terms)


@pytest.mark.parametrize("terms", [EVEN, SWINGING])
def test_edges_of_a_clean_word(terms: int) -> None:
    samples, signs = one_word()
    found = fit(samples, signs, LINE + 1.3 + 0.03 * BETWEEN, terms)
    assert found.settled and found.waver < 10.0
    np.testing.assert_allclose(found.ticks, LINE, atol=0.05)
    for value, expected, tolerance in zip(found.grid, [FIRST + 800.0, CELL], [0.02, 0.002]):
        assert value == pytest.approx(expected, abs=tolerance)


def test_deviations_follow_from_the_scatter_of_edges() -> None:
    samples, signs = one_word()
    for snr_db in (20.0, 0.0):
        errors, stds = [], []
        for seed in range(60):
            noisy = degrade_audio(samples.astype(np.float32), 48000, AudioFaults(snr_db=snr_db, seed=seed))
            found = fit(noisy.astype(float), signs, LINE + 0.4)
            errors.append(found.ticks[[0, -1]] - LINE[[0, -1]])
            stds.append(np.sqrt(found.variance))
        assert 0.8 < np.sqrt(np.mean(np.square(np.array(errors) / stds))) < 1.25
        assert np.std(errors) * 1e6 / 48000 < 10.0 ** ((20.0 - snr_db) / 20.0)


def test_clicks_do_not_move_a_word() -> None:
    samples, signs = one_word(snr_db=40.0)
    quiet = fit(samples, signs, LINE)
    for seed in range(30):
        rng, loud = np.random.default_rng(seed), samples.copy()
        for at in rng.integers(100, 1600, 4):
            loud[at : at + 5] += rng.choice([-1.0, 1.0]) * 2.0 * np.exp(-np.arange(5.0))
        found = fit(loud, signs, LINE)
        assert np.abs(found.ticks - quiet.ticks).max() < 0.1


def test_edges_that_swing_are_told_from_noise() -> None:
    """A swing of half a sample over the word, at 20 dB, is a polynomial and no line."""
    samples, signs = one_word(snr_db=20.0)
    swing = 0.5 * np.sin(1.5 * np.pi * BETWEEN / 40.0)
    at = np.arange(len(samples), dtype=float)
    swung = np.interp(at - np.interp(at, LINE, swing), at, samples)
    assert fit(samples, signs, LINE).waver < 5.0 < 30.0 < fit(swung, signs, LINE).waver
    found = fit(swung, signs, LINE, SWINGING)
    assert np.abs(found.ticks - LINE - swing).max() < 0.2


def test_clipped_edges_hide_where_they_are() -> None:
    samples, signs = one_word()
    plain, square = fit(samples, signs, LINE), fit(LEVEL * np.sign(samples - 0.01), signs, LINE)
    assert plain.variance.max() < 0.05**2
    assert 0.25 < np.sqrt(square.variance.min()) < 0.5
