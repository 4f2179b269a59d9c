"""The exponent is found where sizes differ, and stays 0 where they say nothing."""
import numpy as np
import pytest

from panoptic_ros.assembly.noise_growth import NoiseGrowth, box_diagonals


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


def test_box_diagonals_take_the_joints_that_are_there():
    plane = np.array([[[0.0, 0.0], [3.0, 4.0], [9.0, 9.0]], [[1.0, 1.0], [5.0, 5.0], [7.0, 7.0]]])
    scores = np.array([[0.5, 0.5, 0.0], [0.0, 0.9, 0.0]])
    assert box_diagonals(plane, scores).tolist() == [5.0, 0.0]
    assert box_diagonals(plane, np.zeros((2, 3))).tolist() == [0.0, 0.0]
