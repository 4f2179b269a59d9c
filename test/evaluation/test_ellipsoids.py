"""Errors against the ellipsoids that covariances state."""

import numpy as np
import pytest

from panoptic_ros.evaluation.ellipsoids import ELLIPSOID_95, EllipsoidTally, squared_distances
from panoptic_ros.evaluation.pairing import pair_sequences
from panoptic_ros.evaluation.sequences import SkeletonFrame, SkeletonSequence

NAMES = ("a", "b", "c", "d")
PLACES = np.array([[0.0, 0.0, 1.0], [0.0, 0.4, 1.0], [0.3, 0.0, 1.0], [0.3, 0.4, 1.5]])
OFF = np.array([[0.01, 0.0, 0.0], [0.0, 0.0, 0.03], [0.0, 0.05, 0.0], [np.nan] * 3])  # m
SIGMA = np.array([0.01, 0.02, 0.01])  # m, along the axes


def pairs():
    """Two people, of whom the second is not found; one joint of the first is missing."""
    truth = SkeletonFrame(0, np.array([3, 4]), np.stack([PLACES, PLACES + 5.0]))
    spread = np.tile(np.diag(SIGMA**2), (1, 4, 1, 1))
    result = SkeletonFrame(0, np.array([7]), (PLACES + OFF)[None], spread, views=np.array([[2, 1, 3, 0]]))
    return pair_sequences(SkeletonSequence(NAMES, (truth,)), SkeletonSequence(NAMES, (result,)))


def test_distances_are_those_of_the_covariance():
    rng = np.random.default_rng(0)
    gaps, factors = rng.standard_normal((50, 3)), rng.standard_normal((50, 3, 3))
    spreads = factors @ factors.swapaxes(-1, -2) + 0.1 * np.eye(3)
    gaps[3] = np.nan
    expected = np.einsum("ni,nij,nj->n", gaps, np.linalg.inv(spreads), gaps)
    assert squared_distances(gaps, spreads) == pytest.approx(expected, nan_ok=True)


def test_rows_are_of_joints_by_the_views_that_see_them():
    tally = EllipsoidTally()
    for pair in pairs():
        tally.take(pair)
    rows = tally.rows()
    assert rows["all"] == pytest.approx(
        {"given": 3 / 8, "mean_mm": 30.0, "p95_mm": 48.0, "in_ellipsoid": 2 / 3}
    )  # of 1, 3 and 2.5 standard deviations
    assert rows["two views and more"] == pytest.approx(
        {"given": 2 / 8, "mean_mm": 30.0, "p95_mm": 48.0, "in_ellipsoid": 1.0}
    )
    assert rows["one view"]["mean_mm"] == pytest.approx(30.0) and rows["one view"]["in_ellipsoid"] == 0.0
    assert "no view" not in rows


def test_people_who_are_not_asked_for_do_not_count():
    one, other = EllipsoidTally(), EllipsoidTally()
    for pair in pairs():
        one.take(pair, (3,))
        other.take(pair, (4,))
    assert one.rows()["all"]["given"] == 3 / 4
    assert other.rows() == {} and other.asked == 4


def test_normal_errors_lie_in_their_ellipsoids_as_often_as_they_should():
    gaps = np.random.default_rng(1).standard_normal((100_000, 3)) * SIGMA
    squares = squared_distances(gaps, np.broadcast_to(np.diag(SIGMA**2), (len(gaps), 3, 3)))
    assert (squares < ELLIPSOID_95).mean() == pytest.approx(0.95, abs=0.003)
