"""The edges of a word one by one: where they are, and whether they swing."""

from __future__ import annotations

import numpy as np
import pytest

from panoptic_ros.timecode.word.edge_kernels import line_through, waver

CELLS = np.sort(np.random.default_rng(5).choice(np.arange(-40.0, 40.5, 0.5), 110, replace=False))


def test_the_line_through_edges_is_that_of_weighted_least_squares() -> None:
    rng = np.random.default_rng(6)
    noise = rng.uniform(0.5, 2.0, len(CELLS))
    places = 850.0 + 20.0 * CELLS + rng.normal(size=len(CELLS))
    (middle, cell), covariance = line_through(CELLS, places, noise)
    rows = np.stack([np.ones_like(CELLS), CELLS])
    expected = np.linalg.inv(rows / noise @ rows.T)
    np.testing.assert_allclose(covariance, expected, rtol=1e-9)
    np.testing.assert_allclose([middle, cell], expected @ (rows / noise @ places), rtol=1e-12)


def test_edges_that_swing_are_told_from_those_that_scatter() -> None:
    rng = np.random.default_rng(7)
    ratios = [waver(CELLS, rng.normal(size=len(CELLS)), np.ones(len(CELLS)), 6)[0] for _ in range(400)]
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.1)  # the mean of an F statistic
    assert max(ratios) < 6.0
    swing = 2.0 * np.sin(2.0 * np.pi * CELLS / 80.0) + 7.0 - 0.02 * CELLS
    ratio, square = waver(CELLS, swing + rng.normal(size=len(CELLS)), np.ones(len(CELLS)), 6)
    line = np.polyval(np.polyfit(CELLS, swing, 1), CELLS)
    assert ratio > 8.0
    assert square == pytest.approx(np.mean((swing - line) ** 2), rel=0.3)
