"""The noise table finds the truth whatever it started from."""
import numpy as np
import pytest

from panoptic_ros.assembly.noise import NoiseGrowth, NoiseTable


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
        sizes = np.full(600, 0.2)
        table.learn(scores, kinds, cameras, sizes, np.where(outlier, 400.0, pixels), diagonals)
    for kind in range(3):
        kinds = np.full((2, 2), kind)
        scores, sizes = np.array([[0.25, 0.75], [0.25, 0.75]]), np.array([0.2, 0.2])
        got = table.sigmas(scores, kinds, np.array([0, 1]), sizes, diagonals)
        expected = (1.0 + 0.2 * kind) * true_share[None] * (true_factor * diagonals)[:, None]
        assert np.abs(np.log(got / expected)).max() < 0.3


def test_nothing_learnt_is_the_start():
    table = NoiseTable(1, 0.002, 1000.0)
    nothing, none = np.empty(0), np.empty(0, int)
    table.learn(nothing, none, none, nothing, nothing, np.array([1000.0]))
    sizes, diagonals = np.array([0.2]), np.array([1000.0])
    assert table.sigmas(np.array([[0.5]]), np.array([[0]]), np.array([0]), sizes, diagonals) == 2.0


@pytest.mark.parametrize("exponent", [0.0, 0.5, 1.0])
def test_learns_the_growth_with_size_beside_the_scores(exponent):
    rng = np.random.default_rng(1)
    diagonals = np.array([1000.0])
    table = NoiseTable(1, 0.002, 4000.0)
    for _ in range(60):
        scores, sizes = rng.choice([0.25, 0.75], 400), rng.uniform(0.1, 0.6, 400)
        sigma = np.where(scores > 0.5, 1.0, 3.0) * (sizes / 0.3) ** exponent
        pixels = np.hypot(*rng.standard_normal((2, 400))) * sigma
        pixels = np.where(rng.random(400) < 0.05, 40.0, pixels)
        none = np.zeros(400, int)
        table.learn(scores, none, none, sizes, pixels, diagonals)
    sizes = np.array([0.15, 0.3, 0.6])
    kinds = np.zeros((3, 2), int)
    got = table.sigmas(np.tile([0.25, 0.75], (3, 1)), kinds, np.zeros(3, int), sizes, diagonals)
    expected = np.array([3.0, 1.0]) * (sizes[:, None] / 0.3) ** exponent
    assert np.abs(np.log(got / expected)).max() < 0.15


def rayleigh(rng, count):
    return np.hypot(*rng.standard_normal((2, count))) / 1.17741


@pytest.mark.parametrize("exponent", [0.0, 0.4, 1.0])
def test_finds_the_exponent_among_outliers(exponent):
    rng = np.random.default_rng(0)
    growth = NoiseGrowth(4000.0)
    for _ in range(40):
        sizes = rng.uniform(0.1, 0.8, 300)
        ratios = rayleigh(rng, 300) * sizes**exponent
        growth.learn(sizes, np.where(rng.random(300) < 0.05, 20.0, ratios))
    assert growth.exponent == pytest.approx(exponent, abs=0.1)
    assert growth.factors(np.array([0.2]))[0] / growth.factors(np.array([0.4]))[0] == pytest.approx(
        0.5**exponent, rel=0.1
    )


def test_equal_sizes_few_residuals_and_falling_noise_say_nothing():
    rng = np.random.default_rng(0)
    equal, few, falling = (NoiseGrowth(4000.0) for _ in range(3))
    equal.learn(np.full(3000, 0.3), 5.0 * rayleigh(rng, 3000))
    few.learn(np.array([0.2, 0.4]), np.array([0.1, 10.0]))
    sizes = rng.uniform(0.1, 0.8, 3000)
    falling.learn(sizes, rayleigh(rng, 3000) / sizes)
    assert equal.exponent == pytest.approx(0.0, abs=1e-6) and falling.exponent == 0.0
    assert few.exponent < 0.1
    assert equal.factors(sizes) == pytest.approx(1.0, abs=1e-6)


def test_follows_a_change_and_forgets():
    rng = np.random.default_rng(2)
    growth = NoiseGrowth(2000.0)
    for exponent in (1.0, 0.0):
        for _ in range(40):
            sizes = rng.uniform(0.1, 0.8, 300)
            growth.learn(sizes, rayleigh(rng, 300) * sizes**exponent)
        assert growth.exponent == pytest.approx(exponent, abs=0.15)
