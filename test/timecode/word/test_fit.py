"""Starts of words and their deviations, against the truth and the bound of Cramer and Rao."""

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
from panoptic_ros.timecode.signal.edge_shape import EdgeShape
from panoptic_ros.timecode.signal.grid import Grid
from panoptic_ros.timecode.signal.wave import Edges, Samples, train_rows
from panoptic_ros.timecode.word.fit import fit_word
from panoptic_ros.timecode.word.fit_kernels import misfit
from panoptic_ros.timecode.word.unseen_kernels import jumps, widest_gap


@pytest.mark.parametrize("rate", [8000, 16000, 44100, 48000, 96000])
def test_fit_of_a_clean_word_is_exact(rate: int) -> None:
    signal = encode_ltc(Timecode.from_frame_count(777, timecode_rate("25")), 3, rate, lead=33.3)
    bits = np.array(word_bits(signal.labels[1]))
    cell = rate / 2000
    raw = signal.samples.astype(float)
    guess = Grid(signal.starts[1] + 40.07 * cell, 1.0003 * cell)
    fit = fit_word(Samples(0, raw), bits, guess, rate, EdgeShape(rate))
    assert fit is not None
    microseconds = 1e6 * (fit.middle - signal.starts[1] - 40 * cell) / rate
    assert abs(microseconds) < {8000: 6.0, 16000: 3.0}.get(rate, 0.5)  # the edges are not band-limited
    assert fit.cell == pytest.approx(cell, rel=1e-4)
    late = guess._replace(middle=guess.middle + 140 * cell)
    assert fit_word(Samples(0, raw), bits, late, rate, EdgeShape(rate)) is None  # not all there


def test_fit_reaches_the_bound_of_cramer_and_rao() -> None:
    """var >= N0/2 sqrt(pi) s / (2 N A^2) for N Gaussian edges of standard deviation s."""
    rate, snr_db = 48000, 10.0
    signal = encode_ltc(Timecode.from_frame_count(777, timecode_rate("30")), 1, rate, lead=50.0, tail=50.0)
    bits = np.array(word_bits(signal.labels[0]))
    errors, stds = [], []
    for seed in range(60):
        raw = degrade_audio(signal.samples, rate, AudioFaults(snr_db=snr_db, seed=seed)).astype(float)
        fit = fit_word(Samples(0, raw), bits, Grid(850.4, 20.0), rate, EdgeShape(rate))
        assert fit is not None
        errors.append(fit.middle - 850.0)
        stds.append(np.sqrt(fit.observed[0, 0]))
    edges, s, noise = 81 + bits.sum(), 15.6e-6 * rate, 10 ** (-snr_db / 20)
    bound = np.sqrt(noise**2 * np.sqrt(np.pi) * s / (2 * edges))
    assert np.std(errors) == pytest.approx(bound, rel=0.3)
    assert np.mean(stds) == pytest.approx(bound, rel=0.15)


def test_clicks_do_not_move_a_word() -> None:
    """They are left out, and what was left out does not hold the fit where it was with them."""
    rate = 48000
    signal = encode_ltc(Timecode.from_frame_count(777, timecode_rate("30")), 1, rate, lead=50.0, tail=50.0)
    bits, guess = np.array(word_bits(signal.labels[0])), Grid(850.4, 20.0)
    errors, ratios = [], []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        raw = degrade_audio(signal.samples, rate, AudioFaults(snr_db=40.0, seed=seed)).astype(float)
        quiet = fit_word(Samples(0, raw), bits, guess, rate, EdgeShape(rate))
        assert quiet is not None and not quiet.clicked
        for at in rng.integers(100, 1600, 4):
            raw[at : at + 5] += rng.choice([-1.0, 1.0]) * 2.0 * np.exp(-np.arange(5.0))
        fit = fit_word(Samples(0, raw), bits, guess, rate, EdgeShape(rate))
        assert fit is not None and fit.clicked
        errors.append(fit.middle - quiet.middle)
        ratios.append((fit.middle - 850.0) / max(np.sqrt(fit.observed[0, 0]), np.sqrt(fit.covariance[0, 0])))
    assert np.std(errors) < np.sqrt(quiet.observed[0, 0])
    assert 0.7 < np.sqrt(np.mean(np.square(ratios))) < 1.4


def test_clipped_edges_hide_where_they_are() -> None:
    signal = encode_ltc(Timecode.from_frame_count(777, timecode_rate("25")), 3, 48000).samples.astype(float)
    assert jumps(signal, 0.25) == 0.0
    assert jumps(np.sign(signal - 0.01), 1.0) > 0.9


def test_widest_gap() -> None:
    assert widest_gap(np.array([3.1, 7.2, 0.6]), 1.0) == pytest.approx(0.5)
    assert widest_gap(np.array([5.25]), 0.5) == pytest.approx(0.5)


def test_misfit_is_seen_in_wrong_shapes_only() -> None:
    rng = np.random.default_rng(3)
    edges = Edges(Grid(400.3, 20.0), np.flatnonzero(rng.integers(0, 3, 36)) - 18.0)
    at = np.arange(-4, 4) + np.arange(9)[:, None] / 8.0
    steep = np.stack([np.zeros_like(at), np.exp(-(at**2))])
    rows = train_rows(Samples(0, np.zeros(800)), edges, steep)
    noise = 0.1 * rng.standard_normal(800)
    wrong = noise + 0.2 * rows[0] * (np.abs(rows[2]) > 0.5)
    assert misfit(0, rows, noise, edges) < 0.05**2
    assert misfit(0, rows, wrong, edges) > 0.05**2
