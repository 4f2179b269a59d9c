"""The noise table finds the truth whatever it started from."""
import numpy as np
import pytest

from panoptic_ros.assembly.noise import NoiseTable


@pytest.mark.parametrize("start", [0.0002, 0.002, 0.02])
def test_learns_scores_and_views(start):
    rng = np.random.default_rng(0)
    diagonals = np.array([2000.0, 1000.0])
    table = NoiseTable(2, start, 4000.0)
    true_share = np.array([0.004, 0.001])  # scores below and above 0.5
    true_factor = np.array([1.0, 3.0])
    for _ in range(100):
        scores, cameras = rng.choice([0.25, 0.75], 600), rng.integers(0, 2, 600)
        kinds = rng.integers(0, 3, 600)
        sigma = true_share[(scores > 0.5).astype(int)] * true_factor[cameras] * diagonals[cameras]
        sigma *= 1.0 + 0.2 * kinds
        pixels = np.hypot(*rng.standard_normal((2, 600))) * sigma
        outlier = rng.random(600) < 0.1
        table.learn(scores, kinds, cameras, np.where(outlier, 400.0, pixels), diagonals)
    for kind in range(3):
        kinds = np.full((2, 2), kind)
        got = table.sigmas(np.array([[0.25, 0.75], [0.25, 0.75]]), kinds, np.array([0, 1]), diagonals)
        expected = (1.0 + 0.2 * kind) * true_share[None] * (true_factor * diagonals)[:, None]
        assert np.abs(np.log(got / expected)).max() < 0.3


def test_nothing_learnt_is_the_start():
    table = NoiseTable(1, 0.002, 1000.0)
    table.learn(np.empty(0), np.empty(0, int), np.empty(0, int), np.empty(0), np.array([1000.0]))
    assert table.sigmas(np.array([[0.5]]), np.array([[0]]), np.array([0]), np.array([1000.0])) == 2.0
