"""Clocks that are found of stamps which others corrected before."""
from dataclasses import replace

import numpy as np

from panoptic_ros.offsets import CameraClocks

NAMES = ("a", "b", "c")


def clocks(reference, offsets, drifts, known, deviation):
    empty = CameraClocks.unknown(NAMES, reference)
    return replace(
        empty, offsets=np.array(offsets), drifts=np.array(drifts), known=np.array(known),
        covariance=np.diag(np.repeat([deviation**2, 1e-12], 3)),
    )  # fmt: skip


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
