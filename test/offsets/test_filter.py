"""Blocks of motion added up: more blocks know more, and clocks that jump are found anew."""

import numpy as np
import pytest

from panoptic_ros.offsets.estimate import JUMP, ClockFilter

CAMERAS = 5
PRIOR = np.repeat([0.1, 5e-5], CAMERAS)
TRUE = np.array([0.03, -0.02, 0.01, -0.04, 0.02])
DEVIATION = 1e-3


def information():
    """Of a block that knows offsets within a millisecond, and nothing that all cameras share."""
    shared = np.eye(CAMERAS) - 1.0 / CAMERAS
    return np.kron(np.diag([1.0, 0.0]), shared) / DEVIATION**2


def estimate(rng, offsets):
    return np.concatenate([offsets + DEVIATION * rng.standard_normal(CAMERAS), np.zeros(CAMERAS)])


@pytest.fixture
def filled():
    """A filter that has seen ten blocks, and its generator."""
    clocks, rng = ClockFilter(CAMERAS, PRIOR, 60.0), np.random.default_rng(1)
    for _ in range(10):
        clocks.move(2.0)
        assert not clocks.add(estimate(rng, TRUE), information()).any()
    return clocks, rng


def error_of(clocks, offsets):
    error = clocks.state()[0][:CAMERAS] - offsets
    return error - error.mean()


def test_blocks_add_up(filled):
    clocks, _ = filled
    deviations = np.sqrt(np.diag(clocks.state()[1])[:CAMERAS])
    assert (deviations < 0.5 * DEVIATION).all()
    assert (np.abs(error_of(clocks, TRUE)) < 4.0 * deviations).all()


@pytest.mark.parametrize("jump", [0.02, -0.15])
def test_a_clock_that_jumps_is_told_once_and_found_anew(filled, jump):
    clocks, rng = filled
    after = TRUE + jump * (np.arange(CAMERAS) == 2)
    clocks.move(2.0)
    halfway = 0.5 * (TRUE + after)  # it jumps in the middle of a block
    jumps = clocks.add(estimate(rng, halfway), information())
    assert np.flatnonzero(jumps).tolist() == [2]
    assert jumps[2] == pytest.approx(0.5 * jump, abs=4e-3)
    deviation = np.sqrt(clocks.state()[1][2, 2])
    assert abs(error_of(clocks, after)[2]) < 3.0 * deviation
    clocks.move(2.0)
    assert not clocks.add(estimate(rng, after), information()).any()
    assert np.abs(error_of(clocks, after)).max() < 4.0 * DEVIATION


def test_two_of_five_may_jump_at_once(filled):
    clocks, rng = filled
    after = TRUE + np.array([0.03, 0.0, 0.0, -0.05, 0.0])
    clocks.move(2.0)
    assert np.flatnonzero(clocks.add(estimate(rng, after), information())).tolist() == [0, 3]
    clocks.move(2.0)
    clocks.add(estimate(rng, after), information())
    assert np.abs(error_of(clocks, after)).max() < 4.0 * DEVIATION


def test_what_all_cameras_share_is_no_jump(filled):
    clocks, rng = filled
    clocks.move(2.0)
    assert not clocks.add(estimate(rng, TRUE + 0.05), information()).any()


def test_chance_is_no_jump():
    rng = np.random.default_rng(2)
    assert JUMP > 4.0
    for _ in range(50):
        clocks = ClockFilter(CAMERAS, PRIOR, 60.0)
        for _ in range(5):
            clocks.move(2.0)
            assert not clocks.add(estimate(rng, TRUE), information()).any()
