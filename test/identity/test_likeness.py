"""How likely somebody who comes is somebody who left."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from panoptic_ros.identity.likeness import (
    FRAME_SIGMA,
    MISTAKEN,
    NEW,
    PEOPLE_SHARE,
    STATURE_SHARE,
    WAIT,
    bone_evidence,
    learnt_bones,
    paired,
    place_evidence,
    recognised,
    seen_bones,
)

LENGTHS = np.linspace(0.1, 0.5, 12)[None]
EACH = np.arange(12)


def seen(lengths, frames=30.0, sigma=0.006):
    """Bones of one person, learnt of so many frames that differ by so much (m)."""
    lengths = np.atleast_2d(lengths)
    return learnt_bones(lengths, np.full(lengths.shape, frames), np.full(lengths.shape, sigma**2))


def odds(one, other, groups=EACH):
    """Those of two people."""
    return bone_evidence(one, other, groups[: one.lengths.shape[1]])[0, 0]


def test_bones_give_the_ratio_of_two_normal_densities():
    one, other = seen([0.30, 0.45, 0.25, np.nan]), seen([0.303, 0.452, 0.253, 0.4])
    mean = 0.5 * (one.lengths + other.lengths)[0, :3]
    noise = np.diag((one.variances + other.variances)[0, :3] / mean**2)
    gaps = (one.lengths - other.lengths)[0, :3] / mean
    people = noise + 2.0 * PEOPLE_SHARE**2 * np.eye(3) + 2.0 * STATURE_SHARE**2
    expected = multivariate_normal(np.zeros(3), noise).logpdf(gaps)
    expected -= multivariate_normal(np.zeros(3), people).logpdf(gaps)
    assert odds(one, other) == pytest.approx(expected, abs=3.0 * 1.5 * MISTAKEN)
    assert odds(one, seen(np.full(4, np.nan))) == pytest.approx(0.0)


def test_bones_say_more_the_longer_and_the_more_exactly_they_were_seen_and_mistakes_are_bounded():
    own = seen(LENGTHS)
    assert 0.0 < odds(seen(LENGTHS, 1.0), own) < odds(seen(LENGTHS, 10.0), own)
    assert odds(seen(LENGTHS, sigma=0.03), own) < odds(seen(LENGTHS, sigma=0.003), own)
    assert odds(seen(1.15 * LENGTHS), own) < odds(seen(1.15 * LENGTHS, 1.0), own) < 0.0
    mistaken = LENGTHS.copy()
    mistaken[0, 3] = 2.0
    assert 0.0 < odds(seen(mistaken), own) < odds(own, own)


def test_bones_of_one_instant_are_as_uncertain_as_its_joints_are_along_them():
    rng = np.random.default_rng(5)
    joints, bones = np.array([[0.0, 0.0, 1.0], [0.5, 0.0, 1.0], [0.5, 0.0, 0.5]]), np.array([[0, 1], [1, 2]])
    flat = np.diag([0.0025, 1e-6, 1e-6])  # uncertain along the first bone alone
    drawn = joints + rng.multivariate_normal(np.zeros(3), flat, (4000, 3))
    found = seen_bones(joints[None], np.tile(flat, (1, 3, 1, 1)), bones)
    assert found.lengths[0].tolist() == [0.5, 0.5]
    spread = seen_bones(drawn, np.tile(flat, (4000, 3, 1, 1)), bones).lengths.var(axis=0)
    least = 1.1 * FRAME_SIGMA**2  # that no frame goes below
    assert found.variances[0, 0] - least == pytest.approx(spread[0], rel=0.1)
    assert found.variances[0, 1] - least == pytest.approx(2e-6)
    strange = seen_bones(1.3 * joints[None], np.tile(flat, (1, 3, 1, 1)), bones)
    known = seen(np.array([0.5, 0.5]))
    assert odds(known, found) > odds(known, strange) > odds(known, seen(np.array([0.65, 0.65])))


def test_people_of_one_stature_are_told_apart_by_their_proportions():
    rng = np.random.default_rng(3)
    other = LENGTHS * rng.normal(1.0, PEOPLE_SHARE * np.sqrt(2.0), LENGTHS.shape)
    assert odds(seen(other), seen(LENGTHS)) < -3.0
    assert odds(seen(LENGTHS + rng.normal(0.0, 0.002, LENGTHS.shape)), seen(LENGTHS)) > 5.0


def test_the_two_sides_of_a_body_tell_its_bones_once():
    bones = np.array([[0, 1], [0, 2], [1, 3], [2, 4], [0, 5]])
    groups = paired(bones, np.array([0, 2, 1, 4, 3, 5]))
    assert groups.tolist() == [0, 0, 1, 1, 2]
    half = np.array([0.2, np.nan, 0.3, 0.3, 0.4])
    both = odds(seen(half), seen([0.2, 0.2, 0.3, 0.3, 0.4]), groups)
    assert 0.0 < both < odds(seen(np.nan_to_num(half, nan=0.2)), seen([0.2, 0.2, 0.3, 0.3, 0.4]), EACH)


def test_the_place_tells_less_and_less():
    distances, unseen = np.array([[0.2], [0.2], [0.2], [5.0]]), np.array([0.1, 1.0, 60.0, 0.5])
    near, later, long_ago, beyond = place_evidence(distances, unseen)[:, 0]
    assert near > later > long_ago == 0.0 and beyond == -np.inf


def test_who_is_recognised_who_is_new_and_who_is_looked_at_for_longer():
    odds = np.array([[6.0, 0.5, -9.0, 1.5, 7.0], [1.0, -3.0, -8.0, 1.2, 6.8]])
    assert recognised(odds, np.zeros(5), 0.6).tolist() == [0, WAIT, NEW, WAIT, WAIT]
    assert recognised(odds, np.ones(5), 0.6).tolist() == [0, NEW, NEW, NEW, NEW]  # a new id, not a wrong one
    assert recognised(np.zeros((0, 2)), np.zeros(2), 0.6).tolist() == [NEW, NEW]


def test_nobody_is_two_people():
    assert recognised(np.array([[7.0, 6.0]]), np.zeros(2), 0.6).tolist() == [0, NEW]
