"""Lines through lags, and how far they are to be trusted."""

from itertools import combinations

import numpy as np
import pytest

from panoptic_ros.offsets.sound.directness import Directness
from panoptic_ros.offsets.sound.lines import (
    Lags,
    SoundClockLines,
    arrivals,
    fit_lines,
    largest_group,
    loops_close,
    settle,
)
from panoptic_ros.offsets.sound.travel import SourcePositions

PLACES = np.array([[0.0, 0.0, 1.5], [5.0, 0.5, 1.5], [4.0, 4.5, 2.0], [0.5, 4.0, 1.0]])


def test_offsets_and_drifts_of_exact_lags_are_found_in_spite_of_false_ones():
    rng = np.random.default_rng(0)
    offsets, drifts = np.array([0.0, 12.5, -80.0, 3.0]), np.array([0.0, 6e-5, -4e-5, 2e-5])
    rows = []
    for a, b in combinations(range(4), 2):
        for common in np.linspace(100.0, 1900.0, 12):
            heard = common - offsets - drifts * (common - 1000.0)
            rows.append((a, b, heard[a], heard[b] - heard[a] + 1e-4 * rng.standard_normal()))
    first, second, times, lags = (np.array(column) for column in zip(*rows))
    first, second = first.astype(int), second.astype(int)
    lags[::17] += 0.3  # false
    lines = fit_lines(4, np.arange(4), Lags(first, second, times, lags, np.full(len(lags), 1e-3)))
    middle = offsets + drifts * (lines.middle - 1000.0)
    assert np.allclose(lines.offsets, middle, atol=5e-4) and np.allclose(lines.drifts, drifts, atol=2e-6)


def test_arrivals_of_a_window_close_all_loops_and_leave_out_who_is_not_linked():
    true = np.array([0.0, 0.01, -0.02, 0.005])
    pairs = [(0, 1), (0, 2), (1, 2)]
    first, second = np.array(pairs).T
    found = arrivals(first, second, true[second] - true[first], np.ones(3), 4)
    assert np.allclose(found[:3], true[:3] - true[:3].mean()) and np.isnan(found[3])
    assert largest_group(5, np.array([0, 3]), np.array([4, 0])).tolist() == [0, 3, 4]


def test_lags_of_one_sound_close_loops_and_those_of_chance_do_not():
    true = np.array([0.0, 0.01, -0.02, 0.005, 0.003])
    first, second = np.array([(0, 1), (0, 2), (1, 2), (2, 3), (0, 3), (3, 4)]).T
    lags = true[second] - true[first] + 0.002 * np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0])
    lags[4] += 0.03
    assert loops_close(first, second, lags, 5).tolist() == [True, True, True, False, False, False]


@pytest.mark.parametrize("places", [1, 2, 3])
def test_stated_deviations_are_those_of_the_errors_from_however_many_places_sound_comes(places):
    """Sound from places that nobody knows, each for windows of a random order, 1 ms of noise."""
    nothing = np.zeros(0, int)
    unheard = Directness(nothing, nothing, np.zeros((0, 1)), np.zeros((0, 1)))
    mean, spread = SourcePositions(PLACES).travel(unheard)
    start = SoundClockLines(np.zeros(4), np.zeros(4), 20.0)
    times = np.arange(0.0, 40.0, 2.0)
    root, ratios = np.linalg.cholesky(spread), []
    for seed in range(60):
        rng = np.random.default_rng([seed, places])
        delays = mean[:, 0] + rng.standard_normal((places, 4)) @ root.T
        who = rng.integers(places, size=len(times))
        arrived = delays[who].T + 1e-3 * rng.standard_normal((4, len(times)))
        settled = settle(start, times, arrived - arrived.mean(axis=0), mean, spread)
        error = settled.lines.offsets[1:] - settled.lines.offsets[0]
        gauge = np.hstack([-np.ones((3, 1)), np.eye(3)])
        stated = np.diag(gauge @ settled.covariance[:4, :4] @ gauge.T)
        ratios.append(np.mean(error**2 / stated))
    assert 0.6 < np.mean(ratios) < 1.4
