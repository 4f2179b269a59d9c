"""The learner of bone lengths against numpy."""

import numpy as np

from panoptic_ros.domain import JointState
from panoptic_ros.identity.bone_lengths import learn_lengths

BONES = np.array([[0, 1], [1, 2], [1, 3]])
MEASURED, FILLED = int(JointState.MEASURED), int(JointState.FILLED)
MEMORY = 300.0


def joints(seed):
    """Positions (4, 3), covariances (4, 3, 3), all measured."""
    rng = np.random.default_rng(seed)
    factor = 0.01 * rng.standard_normal((4, 3, 3))
    return (
        rng.uniform(-1.0, 1.0, (4, 3)),
        factor @ np.swapaxes(factor, -1, -2),
        np.full(4, MEASURED, np.uint8),
    )


def test_lengths_lose_the_noise_across_the_bone():
    (lengths, counts, squares), frames = np.zeros((3, 3)), []
    for frame in range(4):
        positions, covariances, states = joints(frame)
        learn_lengths(positions, covariances, states, BONES, MEMORY, lengths, counts, squares)
        offset = positions[BONES[:, 1]] - positions[BONES[:, 0]]
        spread, length = covariances[BONES].sum(axis=1), np.linalg.norm(offset, axis=1)
        along = np.einsum("bi,bij,bj->b", offset, spread, offset) / length**2
        frames.append(length - 0.5 * (np.trace(spread, axis1=1, axis2=2) - along) / length)
    assert np.allclose(lengths, np.mean(frames, axis=0)) and (counts == 4).all()
    means = np.cumsum(frames, axis=0) / np.arange(1, 5)[:, None]
    assert np.allclose(squares, np.mean((np.array(frames)[1:] - means[:-1]) ** 2, axis=0))


def test_noise_across_the_bone_does_not_lengthen_it():
    rng, sigma = np.random.default_rng(0), 0.03
    (lengths, counts, squares), states = np.zeros((3, 1)), np.full(2, MEASURED, np.uint8)
    spread = np.tile(sigma**2 * np.eye(3), (2, 1, 1))
    for _ in range(200):
        points = np.array([[0, 0, 0], [0, 0, 0.3]]) + rng.normal(0, sigma, (2, 3))
        learn_lengths(points, spread, states, BONES[:1], MEMORY, lengths, counts, squares)
    assert abs(lengths[0] - 0.3) < 0.005


def test_joints_that_are_not_measured_or_uncertain_teach_nothing():
    lengths, counts, squares = np.full(3, np.nan), np.zeros(3), np.zeros(3)
    positions, covariances, states = joints(0)
    states[2] = FILLED
    learn_lengths(positions, covariances, states, BONES, MEMORY, lengths, counts, squares)
    assert counts.tolist() == [1.0, 0.0, 1.0] and np.isnan(lengths).tolist() == [False, True, False]
    covariances[3] = 0.1 * np.eye(3)
    learn_lengths(positions, covariances, states, BONES, MEMORY, lengths, counts, squares)
    assert counts.tolist() == [2.0, 0.0, 1.0]


def test_a_length_far_off_moves_the_mean_by_its_limit():
    lengths, counts, squares = np.array([0.3]), np.array([9.0]), np.zeros(1)
    points, spread = np.array([[0, 0, 0], [0, 0, 0.9]]), np.tile(1e-8 * np.eye(3), (2, 1, 1))
    states = np.full(2, MEASURED, np.uint8)
    learn_lengths(points, spread, states, BONES[:1], MEMORY, lengths, counts, squares)
    assert np.isclose(lengths[0], 0.3 + 3 * 0.01 / 10, atol=1e-5)
