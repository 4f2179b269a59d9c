"""Certainty of clocks against the normal distribution."""

import numpy as np
import pytest

from panoptic_ros.continuous.clocks import CameraTimes
from panoptic_ros.continuous.observability import certain, covariance_of, robust_covariance

RNG = np.random.default_rng(2)
ROOT = RNG.standard_normal((6, 6))
INFORMATION = ROOT @ ROOT.T + np.eye(6)
UNKNOWN = np.array([0, 1, 3, 5])
INSIDE = np.ix_(UNKNOWN, UNKNOWN)
WEIGHTS = np.full(6, 1e-9)


def test_scores_that_scatter_as_assumed_change_nothing():
    found = robust_covariance(INFORMATION, INFORMATION, WEIGHTS, UNKNOWN)
    np.testing.assert_allclose(found, covariance_of(INFORMATION, WEIGHTS, UNKNOWN), atol=1e-9)
    assert found[2].any() == found[4].any() == 0.0
    less = robust_covariance(INFORMATION, 0.5 * INFORMATION, WEIGHTS, UNKNOWN)
    np.testing.assert_allclose(less, found, atol=1e-9)


def test_scores_that_scatter_more_give_the_covariance_of_wrong_noise():
    more = np.outer(ROOT[0], ROOT[0]) + np.outer(ROOT[1], ROOT[1])
    scatter = INFORMATION + more
    plain = covariance_of(INFORMATION, WEIGHTS, UNKNOWN)
    found = robust_covariance(INFORMATION, scatter, WEIGHTS, UNKNOWN)
    np.testing.assert_allclose(found, plain @ scatter @ plain, atol=1e-9)
    assert (np.diag(found)[UNKNOWN] > np.diag(plain)[UNKNOWN]).all()


def test_stated_errors_are_those_of_repetitions_with_persistent_noise():
    """The noise of a line persists for ten samples, and the estimate takes it for white."""
    design = np.stack([np.ones(4000), np.linspace(-1.0, 1.0, 4000)], axis=1)
    estimates, stated = [], []
    for seed in range(200):
        white = np.random.default_rng(seed).standard_normal(4010)
        noise = np.convolve(white, np.ones(10) / np.sqrt(10.0), "valid")[:4000]
        information = design.T @ design
        value = np.linalg.solve(information, design.T @ noise)
        scores = (design * (noise - design @ value)[:, None]).reshape(80, 50, 2).sum(axis=1)
        estimates.append(value)
        stated.append(robust_covariance(information, scores.T @ scores, np.full(2, 1e-9), np.arange(2)))
    squares = np.mean(np.square(estimates), axis=0)
    np.testing.assert_allclose(np.diag(np.mean(stated, axis=0)), squares, rtol=0.25)


def test_noise_that_looks_like_motion_gives_no_information():
    blur = np.diag([0.0, 2.0, 0.0]) * 100.0
    kept = certain(np.diag([50.0, 150.0, 0.0]), blur)
    np.testing.assert_allclose(kept, np.diag([50.0, 0.0, 0.0]), atol=1e-9)


@pytest.mark.parametrize("row, far", [(0, 0.1), (1, 1e-4)])
def test_a_camera_that_is_not_observable_leaves_the_certainty_of_the_others(row, far):
    deviations = np.zeros((3, 5))
    deviations[:2] = [[2e-4], [1e-5]]
    deviations[row, 3] = far
    gauge = np.eye(5) - 0.2
    whole = np.zeros((15, 15))
    whole[:5, :5] = gauge @ np.diag(deviations[0] ** 2) @ gauge
    whole[5:10, 5:10] = gauge @ np.diag(deviations[1] ** 2) @ gauge
    times = CameraTimes(np.zeros((3, 5)), whole)
    assert times.deviations[row, 0] > far / 6.0  # relative to the mean of all cameras
    found = times.referenced()
    others = [0, 1, 2, 4]
    assert (found.deviations[row, others] <= deviations[row, others]).all()
    assert found.deviations[row, 3] == pytest.approx(far, rel=0.01)
    assert found.observable[row].tolist() == [True, True, True, False, True]


@pytest.mark.parametrize(("offset_sd", "applied"), [(4e-3, 3e-5), (0.0, 0.0), (0.1, 0.0)])  # s, s per row
def test_an_estimated_offset_keeps_the_line_delay_that_was_estimated_with_it(offset_sd, applied):
    """Rays of people at row 360 determine the sum of offset and line delay there, not either alone."""
    line_sd, offset = 1.2e-5, -360.0 * 3e-5 * (offset_sd > 0.0)
    covariance = np.zeros((6, 6))
    covariance[np.ix_([1, 5], [1, 5])] = np.outer([offset_sd, -line_sd], [offset_sd, -line_sd])
    estimate = CameraTimes(np.array([[0.0, offset], [0.0, 0.0], [0.0, 3e-5]]), covariance)
    found = estimate.applicable(CameraTimes.given(*np.zeros((3, 2))))
    assert not found.observable[2, 1] and found.values[2, 1] == applied
    assert found.values[0, 1] + 360.0 * found.values[2, 1] == pytest.approx(0.0, abs=1e-9)
