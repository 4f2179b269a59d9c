"""Patches against points of the surface that are known."""

import numpy as np
import pytest

from panoptic_ros.domain.parts import rigid_parts
from panoptic_ros.evaluation.pairing import FramePair
from panoptic_ros.evaluation.surface import SurfaceTruth, association_scores, part_word
from panoptic_ros.io.skeletons import load_skeleton

SKELETON = load_skeleton("coco17")
WORDS = [part_word(part, SKELETON.joint_names) for part in rigid_parts(SKELETON)]


class Patches:
    """What counts of a record of patches."""

    stamp_ns = 40

    def __init__(self, people, parts, positions):
        self.people, self.positions = np.array(people), np.array(positions, float)
        self.parts = np.array([WORDS.index(word) for word in parts])


def a_pair(places):
    """Every person (id 7 + row in the result) stands at a place."""
    truth = np.repeat(np.array(places, float)[:, None], 17, axis=1)
    rows = np.arange(len(places))
    matches = np.stack([rows, rows], axis=1)
    zeros = np.zeros((len(places), 17))
    return FramePair(40, 0, rows, truth, rows + 7, truth, np.zeros((*truth.shape, 3)), zeros, matches, zeros)


def test_parts_are_told_by_side_and_lower_joint():
    assert {"torso", "head", "l elbow", "r wrist", "l knee", "r ankle"} <= set(WORDS)


def test_patches_are_counted_on_the_part_and_person_of_the_nearest_point():
    points = np.array([[[0.0, 0, 0], [0, 0, 1]], [[3.0, 0, 0], [3, 0, 1]]])
    parts = np.array([["torso", "l wrist"], ["torso", ""]], object)
    surface = SurfaceTruth(np.array([0, 40]), np.stack([points + 9.0, points]), parts)
    pairs = [a_pair([[3.0, 0, 0.4], [0.0, 0, 0.4]])]  # the truth's order is not the surface's
    patches = Patches(
        [8, 8, 8, 8, 7, 7, 5],
        ["torso", "l wrist", "r wrist", "torso", "torso", "torso", "torso"],
        [[0, 0, 0.01], [0, 0, 1], [0, 0, 1], [3, 0, 0], [3, 0, 1], [0.5, 0, 0], [0, 0, 0]],
    )
    found = association_scores([patches], pairs, surface, SKELETON)
    # right, right, another part, somebody else; where parts meet nothing is told; one is far from everybody;
    # the last is on nobody of the truth
    assert found["on_part"] == pytest.approx(2 / 4)
    assert found["wrong_person"] == pytest.approx(1 / 5)
    assert found["off_body"] == pytest.approx(1 / 6)


def test_nothing_in_common_is_told_as_unknown():
    surface = SurfaceTruth(np.array([0]), np.zeros((1, 1, 1, 3)), np.array([["torso"]], object))
    patches = Patches([7], ["torso"], [[0, 0, 0]])
    found = association_scores([patches], [a_pair([[0.0, 0, 0]])], surface, SKELETON)
    assert np.isnan(list(found.values())).all()
