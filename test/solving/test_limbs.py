"""Limbs and sides for every skeleton that is installed."""

import numpy as np
import pytest

from panoptic_ros.io.skeletons import load_skeleton, skeleton_names
from panoptic_ros.solving.limbs import SideTest, exchanged_views, limbs_of


@pytest.mark.parametrize("name", skeleton_names())
def test_partners_share_a_limb_and_arms_are_no_legs(name):
    skeleton = load_skeleton(name)
    groups, _, count = limbs_of(skeleton)
    for joint, other in enumerate(skeleton.mirror):
        assert groups[joint] == groups[other] and (groups[joint] < 0) == (joint == other)
    assert set(groups[groups >= 0]) == set(range(count))
    words = [n.lower() for n in skeleton.joint_names]
    wrist = next(i for i, n in enumerate(words) if "wrist" in n)
    ankle = next(i for i, n in enumerate(words) if "ankle" in n)
    shoulder = next(i for i, n in enumerate(words) if "shoulder" in n)
    assert groups[wrist] == groups[shoulder] != groups[ankle]


def test_sides_follow_the_nose(scenes):
    groups, _, count = limbs_of(scenes.skeleton)
    sides = SideTest(scenes.skeleton, groups)
    right = scenes.person(1.0, 2.0, turn=0.7)
    wrong = right[list(scenes.skeleton.mirror)]
    values = sides.right_way(np.stack([right, wrong]))
    assert (values[0] > 0.5).all() and (values[1] < -0.5).all() and values.shape == (2, count)
    blank = right.copy()
    blank[scenes.skeleton.head] = np.nan
    assert (sides.right_way(blank[None]) == 0.0).all()


def test_joints_that_one_view_placed_do_not_turn_the_body_round(scenes):
    groups, _, _ = limbs_of(scenes.skeleton)
    sides = SideTest(scenes.skeleton, groups)
    names = list(scenes.skeleton.joint_names)
    body, views = scenes.person(), np.full((1, 19), 2)
    body[names.index("lShoulder")] += [0.4, -0.2, 0.0]  # on its ray, in front of the nose
    assert sides.right_way(body[None], views).min() < 0.0
    views[0, names.index("lShoulder")] = 1
    assert (sides.right_way(body[None], views) == 0.0).all()


def test_views_vote_by_what_they_see(scenes):
    groups, _, _ = limbs_of(scenes.skeleton)
    source = np.tile(np.arange(19), (1, 3, 1))
    source[0, 0] = scenes.skeleton.mirror
    observed = np.ones((1, 3, 19), bool)
    assert np.allclose(exchanged_views(source, observed, groups), -1.0)
    observed[0, 1:] = False
    assert np.allclose(exchanged_views(source, observed, groups), 1.0)
