"""The common shift, and biases of the detector."""

import numpy as np
import pytest

from panoptic_ros.solving.clock_gauge import acquainted, common_shift


def test_most_cameras_that_agree_keep_their_stamps():
    offsets = np.array([-0.06, -0.06, -0.0605, 0.1, 0.08])
    assert common_shift(offsets, np.full(5, 1e-4)) == pytest.approx(-0.06017, abs=1e-5)


def test_otherwise_the_mean_is_zero():
    offsets = np.array([-0.05, -0.02, 0.01, 0.04, 0.07])
    assert common_shift(offsets, np.full(5, 1e-4)) == pytest.approx(offsets.mean())


def test_what_counts_as_agreement_grows_with_the_deviations():
    offsets = np.array([0.0, 0.006, -0.004, 0.1, -0.1])
    assert common_shift(offsets, np.full(5, 1e-4)) == pytest.approx(offsets.mean())
    assert common_shift(offsets, np.full(5, 0.008)) == pytest.approx(0.002 / 3.0)
    pairs = np.array([-0.0475, 0.0338, -0.0471, 0.0304, 0.0304])
    assert common_shift(pairs, np.full(5, 0.003)) == pytest.approx(0.0946 / 3.0)


def test_a_camera_that_may_be_off_by_anything_leaves_what_is_known_of_the_others():
    covariance = np.diag([1e-3, 1e-3, 0.1, 1e-3]) ** 2
    assert acquainted(covariance).tolist() == [True, True, False, True]


def test_of_cameras_that_share_nobody_the_larger_group_is_known():
    group = np.array([0, 0, 1, 1, 1, 0, 1])
    covariance = 1e-6 * np.eye(7) + 0.01 * (group[:, None] == group)
    assert acquainted(covariance).tolist() == (group == 1).tolist()


def test_where_nothing_is_known_all_count():
    assert acquainted(0.01 * np.eye(4)).all()
