"""The line under one-way delays, against brute force and against delays with a known line."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from panoptic_ros.clocks.envelope import _supporting_edge, fit_lower_line


def delays(kind, count, rng):
    if kind == "typical":
        return rng.gamma(2.0, 7e-4, count) + (rng.random(count) < 0.05) * rng.uniform(2e-3, 25e-3, count)
    return rng.exponential(4e-3, count) + (rng.random(count) < 0.1) * rng.uniform(5e-3, 60e-3, count)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.integers(0, 50), min_size=3, max_size=12))
def test_edge_is_the_best_line_under_all_points(heights):
    """By brute force: of all lines through two points and under the rest, the one nearest to all."""
    x, y = np.arange(len(heights), dtype=float), np.array(heights, float)
    best = np.inf
    for a, b in itertools.combinations(range(len(x)), 2):
        slope = (y[b] - y[a]) / (x[b] - x[a])
        above = y - y[a] - slope * (x - x[a])
        if above.min() >= -1e-9:
            best = min(best, above.sum())
    offset, slope = _supporting_edge(x, y)
    above = y - offset - slope * x
    assert above.min() >= -1e-9 and above.sum() == pytest.approx(best, abs=1e-9)


@pytest.mark.parametrize("kind", ["typical", "loaded"])
@pytest.mark.parametrize("early", [0, 2])
def test_offset_and_drift_under_delays_even_with_stamps_that_are_too_early(kind, early):
    now, scaled = [], []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        x = np.arange(600) / 30.0
        y = 50e-6 * x + delays(kind, 600, rng)
        y[rng.choice(600, early, replace=False)] -= rng.uniform(3e-3, 30e-3, early)
        line = fit_lower_line(x, y)
        ends = np.array([1.0, 20.0])
        now.append(line.offset + 20.0 * line.slope - 1e-3)
        scaled.append(now[-1] / np.sqrt(ends @ line.covariance @ ends))
    assert abs(np.mean(now)) < 1.2e-4 and np.abs(now).max() < 4e-4
    assert np.sqrt(np.mean(np.square(scaled))) < 1.5
