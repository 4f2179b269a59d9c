"""How likely two people are one, by their clothes."""

import numpy as np
import pytest
from scipy.stats import norm

from panoptic_ros.domain import ViewAppearance, ViewSources
from panoptic_ros.identity.appearance import (
    ALIKE,
    LASTING,
    MISTAKEN,
    PEOPLE,
    ClothingColours,
    colour_evidence,
    looks_at,
)

RNG = np.random.default_rng(4)
SHIRT = np.array([[4.5, 0.5, -0.3], [4.0, -0.1, 0.2]])  # torso and legs
OTHER = SHIRT + PEOPLE


def learnt(looks):
    """Colours of one person after looks (N, 2, 3)."""
    colours = ClothingColours.of_new(1)
    for look in np.atleast_3d(looks):
        colours.learn(np.array([0]), look[None])
    return colours


def odds(one, other):
    return colour_evidence(one, other)[0, 0]


def test_looks_become_means_and_what_they_vary_by_and_single_ones_are_cut():
    looks = SHIRT + RNG.normal(0.0, 0.02, (60, 2, 3))
    found = learnt(looks)
    assert np.allclose(found.means[0], looks.mean(axis=0), atol=1e-9) and (found.counts == 60).all()
    assert np.allclose(np.sqrt(found.squares[0]), 0.02, rtol=0.4)
    before = found.means.copy()
    found.learn(np.array([0]), (SHIRT + 5.0)[None])
    assert np.abs(found.means - before).max() < 0.01
    found.learn(np.array([0]), np.full((1, 2, 3), np.nan))
    assert (found.counts == 61).all()


def test_the_evidence_is_the_ratio_of_the_densities_of_one_person_and_of_two():
    one, other = (learnt(SHIRT + RNG.normal(0.0, 0.02, (count, 2, 3))) for count in (20, 9))
    gaps, noise = one.means[0] - other.means[0], (one.noises() + other.noises())[0]
    same = norm.pdf(gaps, scale=np.sqrt(noise)).prod(axis=1)
    apart = norm.pdf(gaps, scale=np.sqrt(noise + 2 * PEOPLE**2)).prod(axis=1)
    ratios = ((1 - MISTAKEN) * same + MISTAKEN * apart) / ((1 - ALIKE) * apart + ALIKE * same)
    assert odds(one, other) == pytest.approx(np.log(ratios).sum())


def test_the_same_colours_tell_how_rare_they_are_and_others_are_not_taken_for_them():
    one = learnt(np.tile(SHIRT, (50, 1, 1)))
    assert 2.0 < odds(one, one) < -np.log(ALIKE).sum()
    assert odds(one, learnt(np.tile(OTHER, (50, 1, 1)))) < -4.0
    half = np.stack([SHIRT[0], OTHER[1]])
    assert -3.0 < odds(one, learnt(np.tile(half, (50, 1, 1)))) < 0.5
    light = SHIRT + [LASTING[0], 0.0, 0.0]
    assert odds(one, learnt(np.tile(light, (50, 1, 1)))) > 2.0
    assert odds(one, ClothingColours.of_new(1)) == 0.0
    torso = np.where([[True], [False]], SHIRT, np.nan)
    assert 0.0 < odds(one, ClothingColours.of_looks(torso[None])) < -np.log(ALIKE[0])


def test_who_returns_keeps_what_was_learnt_before():
    both = ClothingColours(
        *(
            np.concatenate(pair)
            for pair in zip(
                learnt(np.tile(SHIRT, (30, 1, 1))), learnt(np.tile(SHIRT + 0.04, (10, 1, 1))), strict=True
            )
        )
    )
    both.take_over(0, 1)
    assert np.allclose(both.means[1], SHIRT + 0.01) and (both.counts[1] == 40).all()
    empty = ClothingColours.of_new(2)
    empty.take_over(0, 1)
    assert np.isnan(empty.means).all() and not empty.counts.any()


def test_a_look_is_the_median_over_the_views_of_the_instant():
    views = {
        name: ViewAppearance(name, 5, 7, np.stack([SHIRT + shift, OTHER]))
        for name, shift in (("a", -0.1), ("b", 0.0), ("c", 3.0))
    }
    sources = ViewSources(("a", "b", "c", "d"), [7, 7, 7, 7], [[0, 0, 0, 0], [-1, 1, -1, 1], [-1, -1, -1, 0]])
    found = looks_at(sources, views, 3)
    assert np.allclose(found[0], SHIRT) and np.allclose(found[1], OTHER) and np.isnan(found[2]).all()
    assert np.isnan(looks_at(None, views, 2)).all() and np.isnan(looks_at(sources, {}, 3)).all()
