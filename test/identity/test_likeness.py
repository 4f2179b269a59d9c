"""How likely somebody who comes is somebody who left."""
import numpy as np
import pytest
from scipy.stats import norm

from panoptic_ros.identity.likeness import (
    ALIKE,
    BONE_SIGMA,
    FRAME_SIGMA,
    NEW,
    PEOPLE_SHARE,
    WAIT,
    bone_evidence,
    place_evidence,
    recognised,
)


def test_bones_give_the_ratio_of_two_normal_densities():
    one, other = np.array([[0.3, 0.45, np.nan]]), np.array([[0.31, np.nan, 0.4]])
    frames = np.full((1, 3), 20.0)
    noise = np.hypot(BONE_SIGMA, FRAME_SIGMA * np.sqrt(2.0 / 20.0))
    people = np.hypot(noise, np.sqrt(2.0) * PEOPLE_SHARE * 0.305)
    expected = ALIKE * (norm.logpdf(0.01, 0.0, noise) - norm.logpdf(0.01, 0.0, people))
    assert bone_evidence(one, frames, other, frames)[0, 0] == pytest.approx(expected)
    assert bone_evidence(one, frames, np.full((1, 3), np.nan), frames)[0, 0] == 0.0


def test_bones_say_more_the_longer_they_were_seen_and_mistakes_are_bounded():
    bones = np.linspace(0.1, 0.5, 12)[None]

    def odds(other, frames):
        counts = np.full(bones.shape, frames)
        return bone_evidence(bones, counts, other, counts)[0, 0]

    assert 0.0 < odds(bones, 1.0) < odds(bones, 10.0)
    assert odds(1.15 * bones, 10.0) < odds(1.15 * bones, 1.0) < odds(bones, 1.0)
    mistaken = bones.copy()
    mistaken[0, 3] = 2.0
    assert odds(mistaken, 10.0) > 0.0


def test_the_place_tells_less_and_less():
    distances, unseen = np.array([[0.2], [0.2], [0.2], [5.0]]), np.array([0.1, 1.0, 60.0, 0.5])
    near, later, long_ago, beyond = place_evidence(distances, unseen)[:, 0]
    assert near > later > long_ago == 0.0 and beyond == -np.inf


def test_who_is_recognised_who_is_new_and_who_is_looked_at_for_longer():
    odds = np.array([[6.0, 0.5, -9.0, 1.5, 5.0], [1.0, -3.0, -8.0, 1.2, 4.8]])
    assert recognised(odds, np.zeros(5), 0.6).tolist() == [0, WAIT, NEW, WAIT, WAIT]
    assert recognised(odds, np.ones(5), 0.6).tolist() == [0, NEW, NEW, NEW, NEW]
    assert recognised(np.zeros((0, 2)), np.zeros(2), 0.6).tolist() == [NEW, NEW]


def test_nobody_is_two_people():
    assert recognised(np.array([[6.0, 5.0]]), np.zeros(2), 0.6).tolist() == [0, NEW]
