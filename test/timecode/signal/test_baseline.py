"""The slow functions that a fit leaves free, and products with them, against dense matrices."""

from __future__ import annotations

import numpy as np
import pytest

from panoptic_ros.timecode.signal.baseline import Baseline, baseline_of, gram_without, hat_sums
from panoptic_ros.timecode.word.fit_kernels import fit_step, left_over

Array = np.ndarray
CASES = [(1640, 48000), (547, 16000), (273, 8000), (757, 22050), (3281, 96000)]


def dense(slow: Baseline, count: int) -> Array:
    """The functions (T, N) at every sample."""
    knots = slow.step * np.arange(slow.basis.shape[1])
    return np.array([np.interp(np.arange(count), knots, row) for row in slow.basis])


@pytest.mark.parametrize("count, rate", CASES)
def test_functions_are_orthonormal_and_hold_a_line_and_hum(count: int, rate: int) -> None:
    functions = dense(baseline_of(count, rate), count)
    np.testing.assert_allclose(functions @ functions.T, np.eye(len(functions)), atol=1e-9)
    time = np.arange(count) / rate
    for signal, most in ((1.0 + 30.0 * time, 1e-9), (np.sin(2.0 * np.pi * 50.0 * time + 1.0), 5e-4)):
        left = signal - functions.T @ (functions @ signal)
        assert np.abs(left).max() < most


@pytest.mark.parametrize("count, rate", CASES)
def test_products_and_what_is_left_are_those_of_dense_matrices(count: int, rate: int) -> None:
    slow, rng = baseline_of(count, rate), np.random.default_rng(1)
    functions, rows = dense(slow, count), rng.normal(size=(4, count))
    np.testing.assert_allclose(hat_sums(rows, slow.step) @ slow.basis.T, rows @ functions.T, atol=1e-9)
    gram, parts = gram_without(rows, slow)
    np.testing.assert_allclose(parts, rows @ functions.T, atol=1e-9)
    np.testing.assert_allclose(gram, rows @ rows.T - parts @ parts.T, atol=1e-8)
    solution, _, square, weights = fit_step(rows, slow)
    both = np.vstack([rows[:3], functions])
    expected, residual, _, _ = np.linalg.lstsq(both.T, rows[3], rcond=None)
    np.testing.assert_allclose(np.append(solution, weights), expected, atol=1e-8)
    assert square == pytest.approx(float(residual[0]))
    left = left_over(rows, solution, slow, weights)
    np.testing.assert_allclose(left, rows[3] - both.T @ expected, atol=1e-8)
