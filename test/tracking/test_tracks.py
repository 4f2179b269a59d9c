"""Tables of tracks against plain numpy."""

import numpy as np
import pytest

from panoptic_ros.domain import PoseSet
from panoptic_ros.solving.limbs import Limbs
from panoptic_ros.tracking.tracks import BALANCE_TIME, FLOOR, WORST, Tracks, joint_distances

JOINTS = 5
BONES = np.array([[0, 1], [1, 2], [2, 3], [3, 4]])
MIRROR = np.array([0, 2, 1, 4, 3])
LIMBS = Limbs(np.array([-1, 0, 0, 0, 0]), MIRROR, 1)


def poses(positions, index=0, votes=None):
    positions = np.asarray(positions, float)
    shape = positions.shape[:2]
    there = np.isfinite(positions[..., 0])
    covariances = np.where(there[..., None, None], 1e-4 * np.eye(3), np.nan)
    return PoseSet(
        index,
        index,
        "abc",
        positions,
        covariances,
        1.0 * there,
        4 * there,
        1 * there,
        np.ones(shape[0]),
        side_votes=votes,
    )


def people(rng, count):
    positions = rng.normal(size=(count, JOINTS, 3))
    positions[rng.random((count, JOINTS)) < 0.25] = np.nan
    return positions


@pytest.mark.parametrize("seed", range(5))
def test_distances_are_means_over_the_joints_that_both_have(seed):
    rng = np.random.default_rng(seed)
    states = np.concatenate([people(rng, 3), np.zeros((3, JOINTS, 3))], axis=-1)
    variances, positions = rng.uniform(0.0, 0.1, (3, JOINTS, 3)), people(rng, 4)
    roots = rng.uniform(-0.1, 0.1, (4, JOINTS, 3, 3))
    covariances = roots @ roots.swapaxes(-1, -2)
    distance, cost = joint_distances(states, variances, positions, covariances)
    differences = states[:, None, :, :3] - positions[None]
    gaps = np.linalg.norm(differences, axis=-1)
    spreads = covariances[None] + (variances[:, None, :, :1, None] + FLOOR**2) * np.eye(3)
    scaled = np.sqrt(np.einsum("tpji,tpjik,tpjk->tpj", differences, np.linalg.inv(spreads), differences))
    for t in range(3):
        for p in range(4):
            known = np.isfinite(gaps[t, p])
            assert distance[t, p] == pytest.approx(gaps[t, p][known].mean() if known.any() else np.inf)
            costs = np.minimum(scaled[t, p], WORST) + 0.5 * np.log(np.linalg.det(spreads[t, p]) / FLOOR**6)
            assert cost[t, p] == pytest.approx(costs[known].mean() if known.any() else np.inf)


def test_bones_are_averaged_and_the_middle_is_the_median():
    tracks = Tracks.of_new(1, JOINTS, len(BONES), 1)
    rng = np.random.default_rng(3)
    shown = [people(rng, 1) for _ in range(7)]
    for index, positions in enumerate(shown):
        tracks.update(np.array([0]), poses(positions, index), BONES, 0)
    lengths = np.stack([np.linalg.norm(p[0, BONES[:, 0]] - p[0, BONES[:, 1]], axis=-1) for p in shown])
    lengths -= 0.5 * 2 * 2e-4 / lengths  # the noise of both ends across the bone makes it too long
    assert np.allclose(tracks.bodies.lengths[0], np.nanmean(lengths, axis=0))
    assert np.allclose(tracks.bodies.middles[0], np.nanmedian(shown[-1][0], axis=0))
    assert tracks.hits[0] == 7 and tracks.unseen[0] == 0.0


def test_sides_that_most_views_see_exchanged_for_long_are_exchanged():
    tracks = Tracks.of_new(2, JOINTS, len(BONES), 1)
    positions = np.random.default_rng(0).normal(size=(2, JOINTS, 3))
    tracks.update(np.array([0, 1]), poses(positions, votes=np.array([[2.0], [-1.0]])), BONES, 0)
    tracks.exchange_sides(LIMBS)
    assert np.array_equal(tracks.motion.states[0, :, :3], positions[0, MIRROR])
    assert np.array_equal(tracks.motion.states[1, :, :3], positions[1])
    tracks.exchange_sides(LIMBS)  # not again: the balance was turned round
    assert np.array_equal(tracks.motion.states[0, :, :3], positions[0, MIRROR])


@pytest.mark.parametrize("rate", [15.0, 30.0, 60.0])
def test_sides_are_exchanged_after_the_same_time_at_any_frame_rate(rate):
    tracks = Tracks.of_new(1, JOINTS, len(BONES), 1)
    positions = np.random.default_rng(0).normal(size=(1, JOINTS, 3))
    seconds = 0.0
    for index in range(round(6.0 * rate)):
        straight = index < 3.0 * rate
        tracks.predict(1.0 / rate)
        votes = np.array([[-1.0 if straight else 1.0]])
        tracks.update(np.array([0]), poses(positions, index, votes), BONES, 0)
        if tracks.balance[0, 0] <= 0.0:
            seconds += 0.0 if straight else 1.0 / rate
    assert seconds == pytest.approx(BALANCE_TIME * np.log(2.0), abs=1.0 / rate)
