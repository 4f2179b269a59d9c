"""Variances of starts: never negative, and those of least squares where errors are independent."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from panoptic_ros.timecode.follow.lines import cell_line, line_fit
from panoptic_ros.timecode.follow.pace import Pace, place_variance
from panoptic_ros.timecode.signal.grid import Grid
from panoptic_ros.timecode.signal.wave import Samples
from panoptic_ros.timecode.word.fit import WordFit
from panoptic_ros.timecode.word.layout import WORD_CELLS

CELL = 20.0131234  # samples; middles then lie at all places between samples


def fit_at(middle: float, cell: float, white: float, unseen: float = 0.0) -> WordFit:
    """A word whose edges state a variance of the middle, and that of the cell of edges spread evenly."""
    covariance = white * np.diag([1.0, 12.0 / WORD_CELLS**2])
    return WordFit(
        grid=Grid(middle, cell),
        covariance=covariance,
        observed=covariance,
        level=0.25,
        clean=Samples(0, np.zeros(1)),
        clicked=False,
        places=np.linspace(-40.0, 40.0, 110),
        unseen=unseen,
        gap=0.02,
        sudden=0.0,
        waver=1.0,
        swing=0.0,
    )


def stds(middles: np.ndarray, whites: np.ndarray, reverse: bool = False) -> list[float]:
    """The deviations that a pace states for words in a row."""
    pace, found = Pace(reverse), []
    for number, (middle, white) in enumerate(zip(middles, whites)):
        taken = pace.take(number, fit_at(middle, CELL, white), None)
        assert taken is not None
        found.append(taken[1])
    return found


def test_words_that_scatter_less_than_their_edges_state():
    """On a slow bend the middles are exact, the edges state noise, and the noise falls after 60 words."""
    numbers, whites = np.arange(90.0), np.full(90, 1e-3)
    whites[60:] *= 0.3
    middles = WORD_CELLS * CELL * numbers + 0.0051234 * numbers**2
    assert min(stds(middles, whites)) > 0.1 * np.sqrt(3e-4)


@settings(max_examples=40)
@given(
    seed=st.integers(0, 2**31),
    bend=st.floats(-0.02, 0.02),
    scatter=st.floats(0.0, 2.0),
    reverse=st.booleans(),
)
def test_no_words_give_a_negative_variance(seed, bend, scatter, reverse):
    rng = np.random.default_rng(seed)
    numbers = np.arange(30.0)
    whites = 10.0 ** rng.uniform(-8.0, -3.0, 30)
    errors = scatter * np.sqrt(whites) * rng.standard_normal(30)
    middles = WORD_CELLS * CELL * numbers + bend * numbers**2 + errors
    pace = Pace(reverse)
    for number in range(30):
        fit = fit_at(middles[number], CELL, whites[number], unseen=float(rng.choice([0.0, 1e-3])))
        taken = pace.take(number, fit, None)
        if taken is None:  # the speed changes within words
            return
        assert np.isfinite(taken[1]) and taken[1] > 0.0
        passed = pace.passed(fit.grid, fit, None)
        assert np.isfinite(passed[1]) and passed[1] > 0.0


@pytest.mark.parametrize("count", [4, 6, 10])
@pytest.mark.parametrize("side", [-40.0, 40.0])
def test_a_place_beside_the_last_word_has_the_variance_of_least_squares(count, side):
    """Words on a line with independent errors: the place is linear in them, so its variance is exact."""
    variance = 1e-4
    words = np.zeros((4, count))
    words[0], words[2] = np.arange(count), variance
    words[1] = WORD_CELLS * CELL * words[0]
    line = cell_line(line_fit(words), count, count - 1.0, variance)
    assert line.turn == 0.0
    x = words[0] - words[0].mean()
    weights = side * x / (x @ x) / WORD_CELLS
    weights[-1] += 1.0
    found = line.variance_beside(count - 1.0, side, variance)
    assert found == pytest.approx(variance * float(weights @ weights), rel=1e-9)


@given(
    st.floats(1e-12, 1e3),
    st.floats(1e-12, 1e3),
    st.floats(-1.0, 1.0),
    st.floats(-2.0, 2.0),
    st.floats(-80.0, 80.0),
)
def test_a_place_has_the_quadratic_form_of_the_covariance(own, other, correlation, middle, cell):
    both = correlation * np.sqrt(own * other)
    fit = replace(fit_at(0.0, CELL, 1.0), covariance=np.array([[own, both], [both, other]]))
    gradient = np.array([middle, cell])
    exact = float(gradient @ fit.covariance @ gradient)
    found = place_variance(fit, middle, cell)
    size = own * middle**2 + other * cell**2
    assert found >= 0.0 and found == pytest.approx(exact, abs=1e-9 * size + 1e-30)
