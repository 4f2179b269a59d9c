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
from panoptic_ros.timecode.cells import even_parity, half_cells, integrate
from panoptic_ros.timecode.click_kernels import bridge_clicks
from panoptic_ros.timecode.conditioning import Conditioner
from panoptic_ros.timecode.edge_shape import EdgeShape
from panoptic_ros.timecode.kernels import (
    FREE,
    best_path,
    drawn_grid,
    half_levels,
    integral,
    moved_grid,
    soft_bits,
    sync_means,
)
from panoptic_ros.timecode.line_kernels import jumps
from panoptic_ros.timecode.timing import fit_word
from panoptic_ros.timecode.words import SYNC, SYNC_BACK, USER_BITS, USER_WEIGHTS, known_bits


@settings(max_examples=100, deadline=None)
@given(
    st.integers(0, 2_073_599),
    st.sampled_from(["23.976", "24", "25", "29.97", "29.97df", "30"]),
    st.integers(0, 2**32 - 1),
    st.booleans(),
)
def test_known_bits_are_those_that_are_sent(count: int, rate: str, user: int, balanced: bool) -> None:
    label = Timecode.from_frame_count(count, timecode_rate(rate))
    sent, known = np.array(word_bits(label, user, balanced)), known_bits(label)
    fixed = known != FREE
    assert fixed.sum() == 26 + 1 + 16  # digits, drop-frame, sync
    assert (known[fixed] == sent[fixed]).all()
    assert int(USER_WEIGHTS @ sent[USER_BITS]) == user


def test_sync_is_found_in_both_directions_and_nowhere_else() -> None:
    bits = np.array(word_bits(Timecode(23, 59, 59, 29, timecode_rate("30")), 0xFFFFFFFF), np.int8)
    stream = np.tile(bits, 3)
    assert list(np.flatnonzero(sync_means(stream, SYNC, 80) == 16)) == [64]
    assert list(np.flatnonzero(sync_means(stream[::-1].copy(), SYNC_BACK, 80) == 16)) == [0]
    assert not (sync_means(stream, SYNC_BACK, 80) == 16).any()


@settings(max_examples=50, deadline=None)
@given(st.lists(st.floats(-1.0, 1.0), min_size=8, max_size=8), st.lists(st.floats(-0.4, 8.4), min_size=1))
def test_integrals_are_those_of_the_staircase(values: list[float], ends: list[float]) -> None:
    sums = np.concatenate([[0.0], np.cumsum(values)])
    fine = np.repeat(values, 1000)  # sample i covers i - 0.5 to i + 0.5
    for end in ends:
        expected = fine[: max(0, round((end + 0.5) * 1000))].sum() / 1000
        assert integrate(sums, np.array(end)) == pytest.approx(expected, abs=0.01)
        assert integral(sums, end) == pytest.approx(float(integrate(sums, np.array(end))), abs=1e-9)


def wave(bits: tuple[int, ...], sign: int) -> list[int]:
    halves = []
    for bit in bits:
        halves += [sign, -sign] if bit else [sign, sign]
        sign = sign if bit else -sign
    return halves


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.floats(-1.0, 1.0), min_size=12, max_size=12),
    st.lists(st.sampled_from([0, 1, FREE]), min_size=6, max_size=6),
    st.sampled_from([0.0, -3.0, 0.5]),
)
def test_paths_and_soft_bits_are_the_most_likely_ones(
    levels: list[float], wanted: list[int], before: float
) -> None:
    """Brute force over all words of six bits and both polarities."""
    halves, given_bits = np.array(levels), np.array(wanted, np.int8)
    scores: dict[tuple[int, ...], float] = {}
    for bits in itertools.product((0, 1), repeat=6):
        if all(want in (FREE, bit) for want, bit in zip(wanted, bits)):
            scores[bits] = max(float(np.dot(levels, wave(bits, sign))) + sign * before for sign in (1, -1))
    score, found, signs = best_path(halves, given_bits, before)
    assert score == pytest.approx(max(scores.values()), abs=1e-9)
    assert scores[tuple(found)] == pytest.approx(score, abs=1e-9)
    assert list(signs) in [wave(tuple(found), sign) for sign in (1, -1)]
    soft = soft_bits(halves, given_bits, before)
    for k in np.flatnonzero(given_bits == FREE):
        one, zero = (max(s for bits, s in scores.items() if bits[k] == value) for value in (1, 0))
        assert soft[k] == pytest.approx(one - zero, abs=1e-9)


def test_grids_move_and_are_drawn_to_the_edges() -> None:
    grid = np.array([1000.0, 20.0, 1e-4])
    moved = moved_grid(grid, 7.0)
    for u in (-3.0, 0.0, 5.0):
        expected = grid[0] + grid[1] * (7.0 + u + grid[2] * (7.0 + u) ** 2)
        assert moved[0] + moved[1] * (u + moved[2] * u * u) == pytest.approx(expected)
    signal = encode_ltc(Timecode.from_frame_count(777, timecode_rate("30")), 1, 48000, lead=50.5, tail=50)
    sums = np.concatenate([[0.0], np.cumsum(signal.samples.astype(float))])
    guess = np.array([852.3, 20.03, 2e-5])
    _, bits, signs = best_path(half_levels(sums, *guess, -40.0, 80), np.full(80, FREE, np.int8), 0.0)
    assert bits.tolist() == word_bits(signal.labels[0])
    drawn = drawn_grid(sums, guess, signs, 0.25, 3)
    for value, expected, tolerance in zip(drawn, [850.5, 20.0, 0.0], [0.05, 0.002, 2e-6]):
        assert value == pytest.approx(expected, abs=tolerance)


def test_clicks_are_bridged_and_nothing_else() -> None:
    signal = encode_ltc(Timecode.from_frame_count(777, timecode_rate("25")), 3, 48000).samples.astype(float)
    shape = 72, 600, 0.8, 2.4, 28
    np.testing.assert_array_equal(bridge_clicks(signal, *shape), signal)
    bad = signal.copy()
    bad[2000:2006] += 1.5
    bad[3333] -= 2.0
    clean = bridge_clicks(bad, *shape)
    assert np.abs(clean).max() < 0.3
    changed = np.flatnonzero(clean != signal)
    assert set(changed) <= set(range(1998, 2008)) | set(range(3331, 3336))


def test_cells_of_a_clean_signal() -> None:
    signal = encode_ltc(Timecode.from_frame_count(777, timecode_rate("30")), 2, 48000, lead=50.5)
    sums = np.concatenate([[0.0], np.cumsum(signal.samples.astype(float))])
    halves = half_cells(sums, 50.5, 20.0, 160)
    score, bits, _ = best_path(halves, np.full(160, FREE, np.int8), 0.0)
    assert bits.tolist() == [bit for label in signal.labels for bit in word_bits(label)]
    assert score > 0.999 * np.abs(halves).sum()
    np.testing.assert_allclose(half_levels(sums, 50.5, 20.0, 0.0, 0.0, 160), halves, atol=1e-12)
    assert even_parity(halves) and not even_parity(halves[1:-1])


@pytest.mark.parametrize("rate", [8000, 16000, 44100, 48000, 96000])
def test_fit_of_a_clean_word_is_exact(rate: int) -> None:
    signal = encode_ltc(Timecode.from_frame_count(777, timecode_rate("25")), 3, rate, lead=33.3)
    bits = np.array(word_bits(signal.labels[1]))
    cell = rate / 2000
    raw = signal.samples.astype(float)
    guess = np.array([signal.starts[1] + 40.07 * cell, 1.0003 * cell, 0.0])
    fit = fit_word(raw, 0, bits, guess, rate, EdgeShape(rate))
    assert fit is not None
    microseconds = 1e6 * (fit.middle - signal.starts[1] - 40 * cell) / rate
    assert abs(microseconds) < {8000: 6.0, 16000: 3.0}.get(rate, 0.5)  # the edges are not band-limited
    assert fit.cell == pytest.approx(cell, rel=1e-4)
    late = guess + [140 * cell, 0.0, 0.0]
    assert fit_word(raw, 0, bits, late, rate, EdgeShape(rate)) is None  # not all there


def test_fit_reaches_the_bound_of_cramer_and_rao() -> None:
    """var >= N0/2 sqrt(pi) s / (2 N A^2) for N Gaussian edges of standard deviation s."""
    rate, snr_db = 48000, 10.0
    signal = encode_ltc(Timecode.from_frame_count(777, timecode_rate("30")), 1, rate, lead=50.0, tail=50.0)
    bits = np.array(word_bits(signal.labels[0]))
    errors, stds = [], []
    for seed in range(60):
        raw = degrade_audio(signal.samples, rate, AudioFaults(snr_db=snr_db, seed=seed)).astype(float)
        fit = fit_word(raw, 0, bits, np.array([850.4, 20.0, 0.0]), rate, EdgeShape(rate))
        assert fit is not None
        errors.append(fit.middle - 850.0)
        stds.append(fit.middle_std)
    edges, s, noise = 81 + bits.sum(), 15.6e-6 * rate, 10 ** (-snr_db / 20)
    bound = np.sqrt(noise**2 * np.sqrt(np.pi) * s / (2 * edges))
    assert np.std(errors) == pytest.approx(bound, rel=0.3)
    assert np.mean(stds) == pytest.approx(bound, rel=0.15)


def test_clicks_do_not_move_a_word() -> None:
    """They are left out, and what was left out does not hold the fit where it was with them."""
    rate = 48000
    signal = encode_ltc(Timecode.from_frame_count(777, timecode_rate("30")), 1, rate, lead=50.0, tail=50.0)
    bits, guess = np.array(word_bits(signal.labels[0])), np.array([850.4, 20.0, 0.0])
    errors, ratios = [], []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        raw = degrade_audio(signal.samples, rate, AudioFaults(snr_db=40.0, seed=seed)).astype(float)
        quiet = fit_word(raw, 0, bits, guess, rate, EdgeShape(rate))
        assert quiet is not None and not quiet.clicked
        for at in rng.integers(100, 1600, 4):
            raw[at : at + 5] += rng.choice([-1.0, 1.0]) * 2.0 * np.exp(-np.arange(5.0))
        fit = fit_word(raw, 0, bits, guess, rate, EdgeShape(rate))
        assert fit is not None and fit.clicked
        errors.append(fit.middle - quiet.middle)
        ratios.append((fit.middle - 850.0) / max(fit.middle_std, np.sqrt(fit.covariance[0, 0])))
    assert np.std(errors) < quiet.middle_std
    assert 0.7 < np.sqrt(np.mean(np.square(ratios))) < 1.4


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


def test_clipped_edges_hide_where_they_are() -> None:
    signal = encode_ltc(Timecode.from_frame_count(777, timecode_rate("25")), 3, 48000).samples.astype(float)
    assert jumps(signal, 0.25) == 0.0
    assert jumps(np.sign(signal - 0.01), 1.0) > 0.9
