"""Basis of uniform B-splines against scipy."""

import numpy as np
import pytest

from panoptic_ros.geometry.splines import DEGREE, SPAN, basis_at, control_points, spline

ORIGIN, STEP = 3.0, 0.04


@pytest.mark.parametrize("time", [3.0, 3.013, 3.2, 3.279])
def test_basis_and_derivatives_equal_those_of_scipy(time):
    points = np.random.default_rng(1).standard_normal((11, 3))
    curve = spline(ORIGIN, STEP, points)
    basis, slope, bend = np.empty((3, SPAN))
    k = basis_at((time - ORIGIN) / STEP, len(points), basis, slope, bend)
    own = points[k : k + SPAN]
    np.testing.assert_allclose(basis @ own, curve(time), atol=1e-12)
    np.testing.assert_allclose(slope @ own / STEP, curve(time, 1), atol=1e-9)
    np.testing.assert_allclose(bend @ own / STEP**2, curve(time, 2), atol=1e-7)


def test_a_curve_covers_its_span():
    count = control_points(3.0, 3.5, STEP)
    curve = spline(3.0, STEP, np.zeros((count, 1)))
    assert count == 13 + DEGREE and np.isfinite(curve([3.0, 3.5])).all() and np.isnan(curve(2.99)).all()
