"""Landmarks of face, hands and feet: every installed skeleton can be simulated, with sensible shapes."""

import numpy as np
import pytest

from panoptic_ros.errors import UsageError
from panoptic_ros.io.skeletons import load_skeleton, shared_names, skeleton_names
from panoptic_ros.simulation.people import draw_person
from panoptic_ros.simulation.whole_body import landmarks, named_joints

PERSON = draw_person(np.random.default_rng(4), 0, "walk", 1.75, 1.0)
TIMES = np.linspace(0.0, 2.0, 9)


@pytest.mark.parametrize("name", skeleton_names())
def test_every_skeleton_can_be_simulated_with_sane_bones(name):
    skeleton = load_skeleton(name)
    joints = named_joints(PERSON, TIMES, shared_names(name))
    assert joints.shape == (len(TIMES), len(skeleton), 3)
    lengths = np.linalg.norm([joints[:, a] - joints[:, b] for a, b in skeleton.bones], axis=-1)
    assert 0.0 <= lengths.min() and lengths.max() < 0.75


def test_left_lies_on_the_left():
    found = landmarks(PERSON, TIMES)
    left = found["left_shoulder"] - found["right_shoulder"]
    face = load_skeleton("wholebody133")
    names = face.joint_names
    for a, b in face.left_right:
        if names[a].startswith("face"):
            across = ((found[names[a]] - found[names[b]]) * left).sum(-1)
            assert (across > 0.0).all(), names[a]
    for side in ("left", "right"):
        ankle, toe, heel = (found[f"{side}_{n}"] for n in ("ankle", "big_toe", "heel"))
        assert (toe[:, 2] < ankle[:, 2]).all() and (np.linalg.norm(toe - heel, axis=-1) > 0.15).all()


def test_an_unknown_landmark_is_named():
    with pytest.raises(UsageError, match="tail"):
        named_joints(PERSON, TIMES, ("nose", "tail"))
