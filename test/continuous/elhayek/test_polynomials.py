"""Segments, their polynomials, and the blended motion function."""

import numpy as np
import pytest

from panoptic_ros.continuous.elhayek.polynomials import (
    OVERLAP,
    MotionFunction,
    basis,
    extrapolated,
    segments_over,
    wendland,
)


@pytest.fixture
def motion():
    segments = segments_over(0.0, 2.0, 0.3)
    coefficients = np.random.default_rng(0).normal(size=(len(segments), 3, 5))
    return MotionFunction(segments, coefficients)


def test_segments_of_one_length_cover_the_time_with_the_overlap_of_the_paper():
    segments = segments_over(1.0, 6.0, 0.3)
    assert np.diff(segments, axis=1) == pytest.approx(0.3)
    assert segments[0, 0] < 1.0 and segments[-1, 1] > 6.0
    shares = (segments[:-1, 1] - segments[1:, 0]) / 0.3
    assert shares == pytest.approx(shares[0]) and OVERLAP <= shares[0] < OVERLAP + 0.05
    assert len(segments_over(1.0, 1.1, 0.3)) == 1


def test_the_motion_function_has_two_continuous_derivatives(motion):
    step = 1e-4
    for border in motion.segments.ravel()[2:-2]:
        before = motion.at(border - step * np.arange(6)[::-1])
        after = motion.at(border + step * np.arange(6))
        for order, scale in (
            (1, 1e-2),
            (2, 0.05),
        ):  # the third derivative is finite, so jumps vanish with `step`
            jump = np.diff(after, order, axis=0)[0] - np.diff(before, order, axis=0)[-1]
            assert np.abs(jump / step**order).max() < scale * np.abs(motion.coefficients).max() * 20.0**order


def test_a_jump_of_the_polynomials_would_show_without_the_blend(motion):
    border = motion.segments[4, 1]
    ends = [basis(np.array([border]), motion.segments[g], 5) @ motion.coefficients[g].T for g in (4, 5)]
    assert np.abs(ends[0] - ends[1]).max() > 0.5


def test_weights_add_up_to_1_and_equal_polynomials_are_not_changed(motion):
    times = np.linspace(-0.1, 2.1, 500)
    assert motion.weights(times).sum(axis=0) == pytest.approx(1.0)
    line = np.zeros_like(motion.coefficients)
    line[:, :, 0] = motion.segments.mean(axis=1)[:, None]
    line[:, :, 1] = 0.15
    inside = np.clip(times, *motion.segments[[0, -1], [0, 1]])
    assert MotionFunction(motion.segments, line).at(times)[:, 0] == pytest.approx(inside)


def test_the_function_of_wendland_is_1_at_0_and_ends_with_two_derivatives():
    assert wendland(np.array([0.0, 1.0, 1.5])).tolist() == [1.0, 0.0, 0.0]
    near = wendland(1.0 - np.array([0.02, 0.01]))
    assert near[0] / near[1] == pytest.approx(16.0, rel=0.02)  # falls with the fourth power


def test_a_line_is_extrapolated_exactly_and_a_curve_by_its_line_over_the_overlap():
    before, segment = np.array([1.0, 1.3]), np.array([1.12, 1.42])
    line = np.array([[2.0, 0.3, 0.0, 0.0]])
    found = extrapolated(line, before, segment)
    times = np.linspace(1.1, 1.4, 7)
    expected = basis(times, before, 4) @ line.T
    assert basis(times, segment, 4) @ found.T == pytest.approx(expected)
    curve = np.array([[0.0, 0.0, 1.0, 0.3]])
    times = np.linspace(1.12, 1.3, 2001)
    values = (basis(times, before, 4) @ curve.T)[:, 0]
    best = np.polyval(np.polyfit(times, values, 1), times)
    found = extrapolated(curve, before, segment)
    assert (basis(times, segment, 4) @ found.T)[:, 0] == pytest.approx(best, abs=2e-3)
    assert not found[:, 2:].any()
