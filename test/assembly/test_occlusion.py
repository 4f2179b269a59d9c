"""Hidden joints: against a dense walk along lines of sight, and simple scenes."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from panoptic_ros.assembly.occlusion import (
    AHEAD,
    BONE_RADIUS,
    CORE,
    RIM,
    body_bones,
    hidden_joints,
    hidden_observations,
)
from panoptic_ros.solving.limbs import SideTest, limbs_of
from panoptic_ros.solving.scene import CameraPoses

EYE = CameraPoses(np.eye(3)[None], np.zeros((1, 3)), np.zeros(1))  # a camera at the origin that looks along z
NO_BONES = np.zeros((0, 2), np.int64)


def levels(positions, bones, radius=BONE_RADIUS, cams=EYE, asked=None):
    positions = np.asarray(positions, float)
    asked = np.ones((len(positions), 1), bool) if asked is None else np.asarray(asked)
    return hidden_joints(
        positions, np.zeros_like(positions), asked, np.asarray(bones), np.full(len(bones), radius), cams
    )


def test_a_bone_in_front_hides_one_behind_does_not():
    wall = [[-0.5, 0, 2], [0.5, 0, 2]]
    for depth, expected in ((3.0, 2), (2.0 + 0.5 * AHEAD, 0), (1.0, 0)):
        point = [[0.1, 0.0, depth], [0.1, 2.0, depth]]
        assert levels([wall, point], [[0, 1]])[1, 0, 0] == expected


def test_only_people_that_are_asked_for_have_a_level():
    wall, point = [[-0.5, 0, 2], [0.5, 0, 2]], [[0.1, 0.0, 3.0], [0.1, 0.0, 3.5]]
    people, asked = [wall, point, point], [[False], [True], [False]]
    assert levels(people, [[0, 1]], asked=asked)[:, 0].tolist() == [[0, 0], [2, 2], [0, 0]]


def test_levels_follow_the_distance_from_the_bone():
    wall = [[-0.5, 0, 2], [0.5, 0, 2]]
    for share, expected in ((0.9 * CORE, 2), (0.5 * (CORE + RIM), 1), (1.1 * RIM, 0)):
        point = [0.0, share * BONE_RADIUS * 3.0 / 2.0, 3.0]  # at the bone's depth: share of a radius
        assert levels([wall, [point, [9, 9, 3]]], [[0, 1]])[1, 0, 0] == expected


def test_unknown_joints_neither_hide_nor_are_hidden():
    wall = [[-0.5, 0, 2], [np.nan] * 3]
    assert not levels([wall, [[0, 0, 3], [np.nan] * 3]], [[0, 1]]).any()


def test_ends_of_a_bone_are_not_hidden_by_it():
    assert not levels([[[0, 0, 2.0], [0, 0, 3.0]]], [[0, 1]]).any()


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 10_000))
def test_equals_a_walk_along_the_line_of_sight(seed):
    rng = np.random.default_rng(seed)
    people = rng.uniform([-0.3, -0.3, 2.0], [0.3, 0.3, 4.0], (3, 3, 3))
    got = levels(people, [[0, 1]], radius=0.1)[:, 0]
    share = np.linspace(0.0, 1.0, 4001)[:, None]
    for p in range(3):
        for j in range(3):
            nearest = 9.0
            x = people[p, j]
            for q in range(3):
                if p == q and j < 2:
                    continue
                # the kernel interpolates along the projected bone: depth is linear on the image plane
                a, b = people[q, 0], people[q, 1]
                flat = a[:2] / a[2] + share * (b[:2] / b[2] - a[:2] / a[2])
                gap = np.linalg.norm(flat - x[:2] / x[2], axis=1)
                i = gap.argmin()
                depth = a[2] + share[i, 0] * (b[2] - a[2])
                if depth + AHEAD <= x[2]:
                    nearest = min(nearest, gap[i] * depth / (0.1 * (0.7 if p == q else 1.0)))
            if abs(nearest - CORE) > 0.01 and abs(nearest - RIM) > 0.01:
                assert got[p, j] == (2 if nearest < CORE else 1 if nearest < RIM else 0)


def test_people_behind_one_another(scenes):
    skeleton = scenes.skeleton
    groups, _, _ = limbs_of(skeleton)
    bones, radii = body_bones(skeleton, SideTest(skeleton, groups).torso)
    assert len(bones) == len(skeleton.bones) + 2
    rig = scenes.ring(4)
    stack = rig.stack()
    people = np.stack([scenes.person(0, 0), scenes.person(0, 0)])
    away = stack.centres[0] * [1, 1, 0]
    people[1] -= 0.8 * away / np.linalg.norm(away)  # behind the first, seen from camera 0
    hidden = hidden_joints(
        people,
        np.zeros_like(people),
        np.ones((2, 4), bool),
        bones,
        radii,
        CameraPoses(stack.rotations, stack.translations, np.zeros(4)),
    )
    assert hidden[1, 0].mean() > hidden[0, 0].mean()
    assert (hidden[1, 0] > 0).sum() >= 5


def test_observations_take_the_level_of_the_joint_that_they_stand_for():
    hidden = np.array([[[2, 0, 1], [0, 1, 0]]])  # one person, two views, three joints
    source = np.array([[[1, 0, 2], [0, 1, 2]]])  # joints 0 and 1 exchanged in the first view
    rows = hidden_observations(hidden, np.array([[1, -1]]), source, 2)
    assert rows.tolist() == [[0, 0, 0], [0, 2, 1]]
