"""The compiled loops over bones against numpy."""
import numpy as np

from panoptic_ros.refinement.bones import BoneLengths
from panoptic_ros.refinement.kalman import raise_speeds

BONES = np.array([[0, 1], [1, 2], [1, 3]])


def joints(seed):
    """Positions (4, 3) and covariances (4, 3, 3) of some skeleton."""
    rng = np.random.default_rng(seed)
    factor = 0.01 * rng.standard_normal((4, 3, 3))
    return rng.uniform(-1.0, 1.0, (4, 3)), factor @ np.swapaxes(factor, 1, 2)


def test_lengths_lose_the_noise_across_the_bone():
    lengths, everything = BoneLengths(BONES), np.ones(4, bool)
    expected = np.zeros(3)
    for frame in range(4):
        positions, covariances = joints(frame)
        lengths.learn(positions, covariances, everything)
        for i, (a, b) in enumerate(BONES):
            offset, spread = positions[b] - positions[a], covariances[a] + covariances[b]
            length = np.linalg.norm(offset)
            across = np.trace(spread) - offset @ spread @ offset / length**2
            expected[i] += length - 0.5 * across / length
    assert np.allclose(lengths.means, expected / 4) and (lengths.counts == 4).all()


def test_missing_joints_teach_nothing():
    lengths = BoneLengths(BONES)
    positions, covariances = joints(0)
    lengths.learn(positions, covariances, np.array([True, True, False, True]))
    assert lengths.counts.tolist() == [1.0, 0.0, 1.0]


def test_a_length_is_a_scalar_measurement_of_both_ends():
    lengths = BoneLengths(BONES[:1])
    positions, covariances = joints(1)
    lengths.means[:], lengths.counts[:] = np.linalg.norm(positions[1] - positions[0]) + 0.02, 20.0
    moved, tightened = lengths.apply(positions, covariances, np.ones(4, bool), 0.01, 10)
    unit = (positions[1] - positions[0]) / np.linalg.norm(positions[1] - positions[0])
    row = np.concatenate([-unit, unit])
    both = np.zeros((6, 6))
    both[:3, :3], both[3:, 3:] = covariances[0], covariances[1]
    expected = row @ both @ row
    total = expected + 0.01**2 * (1.0 + 0.02**2 / (9.0 * (expected + 0.01**2)))
    gain = both @ row / total
    assert np.allclose(moved[:2].ravel(), positions[:2].ravel() + gain * 0.02)
    whole = both - np.outer(gain, gain) * total
    assert np.allclose(tightened[0], whole[:3, :3]) and np.allclose(tightened[1], whole[3:, 3:])
    assert np.array_equal(moved[2:], positions[2:]) and np.array_equal(tightened[2:], covariances[2:])


def test_speeds_are_against_the_median_velocity():
    rng = np.random.default_rng(0)
    states = rng.standard_normal((7, 6))
    states[2] = np.nan
    speeds = np.full(7, 0.5)
    raise_speeds(speeds, states, 1.5)
    known = np.arange(7) != 2
    against = np.linalg.norm(states[:, 3:] - np.median(states[known, 3:], axis=0), axis=1)
    assert np.allclose(speeds[known], np.clip(against, 0.5, 1.5)[known]) and speeds[2] == 0.5
