"""The loops of learning the shape of a step, against plain numpy and scipy."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import BSpline

from panoptic_ros.timecode.signal.edge_shape import EdgeShape
from panoptic_ros.timecode.signal.grid import Grid
from panoptic_ros.timecode.signal.shape_kernels import OWN, corrected, integrated, shape_rows, without_own
from panoptic_ros.timecode.signal.wave import Edges, Samples, train_rows

RATE, COUNT = 48000, 400
GRID, PLACES = Grid(200.3, 20.1), np.array([-8.0, -7.0, -6.5, -6.0, -2.0, 0.0, 3.5, 8.0])
EDGES = Edges(GRID, PLACES)


def test_rows_are_splines_at_every_edge_with_its_sign() -> None:
    shape, values = EdgeShape(RATE), np.random.default_rng(1).normal(size=COUNT)
    train = train_rows(Samples(0, values), EDGES, shape.table)
    rows = shape_rows(train, -2.0, 0, EDGES, shape._splines, shape._knot)
    edges = GRID[0] + GRID[1] * PLACES
    knots = np.arange(-shape.reach, shape.reach + 0.5 * shape._knot, shape._knot)
    for s in range(len(shape._splines)):
        spline = BSpline.basis_element(knots[s : s + 5], extrapolate=False)
        away = np.arange(COUNT) - edges[:, None]
        expected = (np.nan_to_num(spline(away)) * (-1.0) ** np.arange(len(edges))[:, None]).sum(axis=0)
        np.testing.assert_allclose(rows[OWN + s], expected, atol=2e-3)  # tables are read between lines
    np.testing.assert_array_equal(rows[[0, 1, 3, 4, -1]], [*train[:4], values / -2.0])
    np.testing.assert_allclose(rows[2], train[1] * np.linspace(-1.0, 1.0, COUNT), atol=1e-12)
    np.testing.assert_allclose(np.diff(rows[-2]), np.diff(integrated(values)) / 2.0, atol=1e-12)


def test_integrals_are_sums_of_trapezia_without_the_mean() -> None:
    values = np.random.default_rng(2).normal(3.0, 1.0, 50)
    even = values - values.mean()
    steps = 0.5 * (even[1:] + even[:-1])
    np.testing.assert_allclose(np.diff(integrated(values)), steps, atol=1e-12)


def test_what_is_a_words_own_is_taken_away() -> None:
    rows = np.random.default_rng(3).normal(size=(OWN + 6, 60))
    own = np.linalg.qr(rows[:OWN].T)[0]
    rest = rows[OWN:] - rows[OWN:] @ own @ own.T
    np.testing.assert_allclose(without_own(rows @ rows.T), rest @ rest.T, atol=1e-10)


def test_tables_are_the_guess_and_weighted_splines() -> None:
    shape, rng = EdgeShape(RATE), np.random.default_rng(4)
    weights = rng.normal(size=len(shape._splines))
    expected = shape.table + np.tensordot(weights, shape._splines, axes=1)
    np.testing.assert_allclose(corrected(shape.table, shape._splines, weights), expected, atol=1e-12)
