"""Biases of made people, whose offsets are known."""

import numpy as np
from scipy.spatial.transform import Rotation

from panoptic_ros.domain import BiasTable
from panoptic_ros.evaluation.bias import MatchedPeople, leave_one_out, measure_offsets

TORSO, MIRROR = (0, 1, 2, 3), np.array([1, 0, 3, 2, 4])
BODY = np.array([[0.0, 0.2, 1.4], [0.0, -0.2, 1.4], [0.0, 0.15, 0.9], [0.0, -0.15, 0.9], [0.1, 0.0, 1.6]])
OFFSETS = np.array(
    [[0.01, 0.02, -0.08], [0.01, -0.02, -0.08], [-0.07, 0.02, 0.0], [-0.07, -0.02, 0.0], [0, 0, 0.05]]
)


def made_people(count, noise, seed=0):
    """Estimates of three people of different sizes, and the truth beside them."""
    rng = np.random.default_rng(seed)
    ids = np.arange(count) % 3
    turns = Rotation.from_euler("z", rng.uniform(0, 6, (count, 1))).as_matrix()
    results = np.einsum("mik,mjk->mji", turns, BODY * (0.9 + 0.1 * ids)[:, None, None])
    truth = BiasTable("t", OFFSETS, TORSO).corrected(results)
    return MatchedPeople(ids, truth + rng.normal(0, noise, truth.shape), results)


def test_known_offsets_are_found():
    people = made_people(30, 0.0)
    assert np.allclose(measure_offsets(people, TORSO, MIRROR), OFFSETS, atol=1e-12)


def test_outliers_and_missing_joints_do_no_harm():
    people = made_people(300, 0.005)
    people.truth[::10] += 1.0
    people.result[1::10, 4] = np.nan
    assert np.abs(measure_offsets(people, TORSO, MIRROR) - OFFSETS).max() < 0.006


def test_a_joint_that_nobody_shows_has_no_offset():
    people = made_people(30, 0.0)
    people.truth[:, 4] = np.nan
    offsets = measure_offsets(people, TORSO, MIRROR)
    assert np.isnan(offsets[4]).all() and np.allclose(offsets[:4], OFFSETS[:4])


def test_people_are_judged_by_what_the_others_say():
    people = made_people(300, 0.002)
    strange = people.ids == 2
    people.truth[strange] = people.result[strange]  # one without any bias
    first, _, third = leave_one_out(people, TORSO, MIRROR)
    assert first.person == 0 and first.median_after < first.median_before - 10.0 and first.pck_after == 1.0
    assert third.median_before == 0.0 and third.median_after > 15.0
