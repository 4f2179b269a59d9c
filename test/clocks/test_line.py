"""Robust lines."""

from __future__ import annotations

import numpy as np
import pytest

from panoptic_ros.clocks.line import fit_line


def test_exact_points_give_the_exact_line() -> None:
    x = np.linspace(-10.0, 10.0, 50)
    line = fit_line(x, 0.003 + 4e-5 * x, np.full(50, 1e-6))
    assert line.offset == pytest.approx(0.003, abs=1e-12)
    assert line.slope == pytest.approx(4e-5, abs=1e-13)
    assert line.covariance[0, 0] >= 1e-12 / 50


def test_a_third_of_outliers_does_no_harm() -> None:
    rng = np.random.default_rng(0)
    x = np.linspace(-10.0, 10.0, 600)
    y = 0.003 + 4e-5 * x + rng.normal(0, 1e-5, 600)
    bad = rng.random(600) < 0.33
    y[bad] += rng.uniform(0.002, 0.02, bad.sum())
    line = fit_line(x, y, np.full(600, 1e-6))
    assert abs(line.offset - 0.003) < 5e-6 and abs(line.slope - 4e-5) < 1e-6


def test_the_covariance_is_that_of_the_errors() -> None:
    x = np.linspace(-10.0, 10.0, 100)
    ratios = []
    for seed in range(200):
        noise = np.random.default_rng(seed).normal(0, 1e-5, 100)
        line = fit_line(x, 0.1 + 1e-5 * x + noise, np.full(100, 1e-7))
        errors = np.array([line.offset - 0.1, line.slope - 1e-5])
        ratios.append(float(errors @ np.linalg.solve(line.covariance, errors)))
    assert 1.3 < np.mean(ratios) < 3.0  # two numbers: chi-square with two degrees of freedom


def test_two_points() -> None:
    line = fit_line(np.array([0.0, 1.0]), np.array([0.5, 0.6]), np.zeros(2))
    assert line.offset == pytest.approx(0.5) and line.slope == pytest.approx(0.1)
    assert np.isfinite(line.covariance).all()
