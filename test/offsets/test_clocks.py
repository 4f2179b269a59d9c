"""Clocks that are found of stamps which others corrected before."""

from dataclasses import replace

import numpy as np

from panoptic_ros.offsets.clocks import CameraClocks

NAMES = ("a", "b", "c")


def clocks(reference, offsets, drifts, known, deviation):
    empty = CameraClocks.unknown(NAMES, reference)
    return replace(
        empty,
        offsets=np.array(offsets),
        drifts=np.array(drifts),
        known=np.array(known),
        covariance=np.diag(np.repeat([deviation**2, 1e-12], 3)),
    )


def test_one_after_the_other_moves_stamps_as_both_do():
    first = clocks(10**10, [0.0, 7.5, -3.0], [0.0, 8e-5, -5e-5], [True, True, True], 5e-3)
    second = clocks(3 * 10**10, [-0.02, 0.004, 0.03], [2e-5, 0.0, 1e-5], [True, True, False], 2e-4)
    both = first.then(second)
    for c in range(3):
        for stamp in (0, 2 * 10**10, 10**11):
            moved = stamp * 1e-9
            for step in (first, second):
                if step.applied[c]:
                    moved += step.offsets[c] + step.drifts[c] * (moved - 1e-9 * step.reference_ns)
            found = 1e-9 * stamp + both.offsets[c] + both.drifts[c] * 1e-9 * (stamp - both.reference_ns)
            assert abs(found - moved) < 1e-9
    assert both.known.all() and both.applied.all()
    assert np.allclose(both.deviations, [2e-4, 2e-4, 5e-3])


def test_offsets_are_stated_where_a_clock_was_recorded_not_at_a_far_reference():
    """A clock that shows 50 s less than the reference is known to 1 ms there; its drift to 1e-4."""
    covariance = np.diag([0.0, 0.0, 0.0, 1e-8])
    there = 1e-3**2 + 1e-8 * 50.0**2  # at the reference, 50 s on
    covariance[1, 1], covariance[1, 3], covariance[3, 1] = there, 50.0 * 1e-8, 50.0 * 1e-8
    clocks = replace(
        CameraClocks.unknown(("a", "b"), 1_000 * 10**9),
        offsets=np.array([0.0, 50.0]),
        drifts=np.array([0.0, 2e-5]),
        covariance=covariance,
        known=np.ones(2, bool),
    )
    stamps = np.array([1_000, 950]) * 10**9
    offsets, deviations = clocks.stated_at(stamps)
    assert np.allclose(offsets, [0.0, 49.999]) and np.allclose(deviations, [0.0, 1e-3])
    both = clocks.stated_at(np.stack([stamps, np.full(2, clocks.reference_ns)], axis=1))[1]
    assert np.allclose(both[:, 1], clocks.deviations) and both[1, 1] > 5.0 * both[1, 0]
