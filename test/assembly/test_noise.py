"""The noise table finds the truth whatever it started from."""

from dataclasses import replace

import numpy as np
import pytest
from standing_people import ring

from panoptic_ros.assembly.noise import CARRIED_NOISE, NoiseCovariates, NoiseTable, sizes_of
from panoptic_ros.domain.rig_arrays import RigArrays

RIG = replace(RigArrays.of(ring(2)), diagonals=np.array([2000.0, 1000.0]), focals=np.array([900.0, 800.0]))


def marks(scores, cameras, ages=None, zoom=1.0, kinds=0):
    """2D people of such joints, at two corners of a box of the plane."""
    plane = np.resize([[0.0, 0.0], [0.3, 0.4]], (*scores.shape, 2))
    ages = np.zeros(len(scores)) if ages is None else ages
    kinds = kinds + np.zeros(scores.shape, int)
    shown = plane, np.full(scores.shape, zoom), scores
    return NoiseCovariates(*shown, kinds, cameras, sizes_of(*shown), ages)


def sizes_of_boxes(plane):
    """Of 2D people (D, 2, 2) of two joints."""
    return sizes_of(plane, np.ones(plane.shape[:2]), np.ones(plane.shape[:2]))


def sigmas(table, seen):
    """Standard deviations (D, J) px."""
    return RIG.focals[seen.cameras][:, None] * seen.magnification / table.precisions(seen, RIG)


@pytest.mark.parametrize("start", [0.0002, 0.002, 0.02])
def test_learns_scores_and_views(start):
    rng = np.random.default_rng(0)
    table = NoiseTable(2, start, 4000.0)
    true_share = np.array([0.004, 0.001])  # scores below and above 0.5
    true_factor = np.array([1.0, 3.0])
    rows, joints = np.arange(600), np.zeros(600, int)
    for _ in range(100):
        scores, cameras = rng.choice([0.25, 0.75], 600), rng.integers(0, 2, 600)
        kinds = rng.integers(0, 3, 600)
        sigma = true_share[(scores > 0.5).astype(int)] * true_factor[cameras] * RIG.diagonals[cameras]
        sigma *= 1.0 + 0.2 * kinds
        pixels = np.hypot(*rng.standard_normal((2, 600))) * sigma
        outlier = rng.random(600) < 0.1
        seen = marks(scores[:, None], cameras, kinds=kinds[:, None])
        table.learn(seen, (rows, joints, np.where(outlier, 400.0, pixels)), RIG)
    for kind in range(3):
        seen = marks(np.array([[0.25, 0.75], [0.25, 0.75]]), np.array([0, 1]), kinds=kind)
        expected = (1.0 + 0.2 * kind) * true_share[None] * (true_factor * RIG.diagonals)[:, None]
        assert np.abs(np.log(sigmas(table, seen) / expected)).max() < 0.3


def test_nothing_learnt_is_the_start_and_those_who_were_carried_teach_nothing():
    table, seen = NoiseTable(2, 0.002, 1000.0), marks(np.array([[0.5, 0.0]]), np.array([1]))
    carried = seen._replace(ages=np.array([0.1]))
    nothing = np.empty(0, int)
    table.learn(seen, (nothing, nothing, np.empty(0)), RIG)
    table.learn(carried, (np.array([0]), np.array([0]), np.array([90.0])), RIG)
    assert not table.learnt
    assert table.precisions(seen, RIG) == pytest.approx(np.array([[800.0 / 2.0, 0.0]]))


def test_who_was_carried_has_gone_astray_by_a_share_of_the_size():
    scores, zoom = np.array([[0.5, 0.5]]), 0.8
    seen = marks(scores, np.array([0]), np.array([0.25]), zoom)
    astray = CARRIED_NOISE * 0.5 * (0.5 * zoom * RIG.focals[0])  # a box of 0.5 on the plane
    got = sigmas(NoiseTable(2, 0.002, 1000.0), seen)
    assert got == pytest.approx(np.full((1, 2), np.hypot(0.002 * 2000.0, astray)))


def test_tails_are_the_deviation_of_nine_residuals_in_ten_over_that_of_half():
    rng, count = np.random.default_rng(3), 4000
    scores = np.repeat([0.25, 0.75], count // 2)
    table, seen = NoiseTable(2, 0.002, 8000.0), marks(scores[:, None], np.zeros(count, int))
    pixels = 4.0 * np.hypot(*rng.standard_normal((2, count)))
    far = (scores < 0.5) & (rng.random(count) < 0.3)  # as of limbs that a detector takes for others
    pixels[far] *= 6.0
    for _ in range(5):
        table.learn(seen, (np.arange(count), np.zeros(count, int), pixels), RIG)
    mixed = pixels[scores < 0.5]
    expected = np.quantile(mixed, 0.9) / 2.14597 / (np.median(mixed) / 1.17741)
    tails = table.tails(marks(np.array([[0.25, 0.75, 0.0, 0.95]]), np.array([0])))
    assert expected > 3.0 and tails == pytest.approx(np.array([[expected, 1.0, 1.0, 1.0]]), rel=0.05)


@pytest.mark.parametrize("slope", [0.0, 0.6, 1.0])
def test_learns_how_noise_grows_with_size(slope):
    rng = np.random.default_rng(1)
    table, rows, joints = NoiseTable(2, 0.002, 4000.0), np.arange(300), np.zeros(300, int)
    for _ in range(30):
        sizes = rng.choice([0.1, 0.2, 0.4], 300)
        plane = sizes[:, None, None] * np.array([[0.0, 0.0], [0.6, 0.8]])
        seen = marks(np.full((300, 2), 0.5), np.ones(300, int))._replace(sizes=sizes_of_boxes(plane))
        sigma = 2.0 * (sizes / 0.2) ** slope
        table.learn(seen, (rows, joints, np.hypot(*rng.standard_normal((2, 300))) * sigma), RIG)
    seen = marks(np.full((2, 2), 0.5), np.ones(2, int))._replace(sizes=np.array([0.1, 0.4]))
    assert sigmas(table, seen)[:, 0] == pytest.approx(2.0 * 2.0 ** np.array([-slope, slope]), rel=0.12)
    assert sizes_of_boxes(np.zeros((1, 2, 2)))[0] == 0.0  # of one joint
