"""Bodies keep their limbs, move smoothly and stay on the floor, at every instant."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from panoptic_ros.errors import UsageError
from panoptic_ros.io.skeletons import load_skeleton
from panoptic_ros.simulation import ACTIVITIES, SKELETON
from panoptic_ros.simulation.body import reach
from panoptic_ros.simulation.people import draw_group, draw_person
from panoptic_ros.simulation.skeleton import J
from panoptic_ros.simulation.stagings import STAGINGS, StagingArea

STEP = 1e-3  # s


def somebody(activity, seed):
    rng = np.random.default_rng(seed)
    return draw_person(rng, 0, activity, rng.uniform(1.1, 1.95), area=2.0)


def test_the_joints_are_those_of_the_default_skeleton():
    assert SKELETON.joint_names == load_skeleton("panoptic19").joint_names
    assert {frozenset(p) for p in SKELETON.left_right} == {
        frozenset(p) for p in load_skeleton("panoptic19").left_right
    }


@pytest.mark.parametrize("activity", ACTIVITIES)
@pytest.mark.parametrize("seed", [0, 1])
def test_limbs_are_constant_and_motion_is_smooth(activity, seed):
    joints = somebody(activity, seed).joints(np.arange(0.0, 3.0, STEP))
    for a, b in SKELETON.bones:
        length = np.linalg.norm(joints[:, a] - joints[:, b], axis=1)
        assert np.ptp(length) < 1e-9, (SKELETON.joint_names[a], SKELETON.joint_names[b])
    acceleration = np.diff(joints, 2, axis=0) / STEP**2
    assert np.abs(np.diff(acceleration, axis=0)).max() < 15.0, "acceleration jumps"


@pytest.mark.parametrize("activity", ACTIVITIES)
def test_feet_are_on_the_floor_and_heads_up(activity):
    person = somebody(activity, 3)
    joints = person.joints(np.arange(0.0, 4.0, 0.02))
    ankles = joints[:, [J["lAnkle"], J["rAnkle"]], 2]
    assert ankles.min() > 0.02 and ankles.min(axis=1).max() < 0.16
    assert (joints[:, J["Nose"], 2] > joints[:, J["BodyCenter"], 2]).all()
    assert joints[..., 2].max() < 1.5 * person.body.height


def test_a_planted_foot_stays_where_it_is():
    person = somebody("walk", 5)
    ankle = person.joints(np.arange(0.0, 4.0, STEP))[:, J["lAnkle"]]
    speed = np.linalg.norm(np.diff(ankle, axis=0), axis=1) / STEP
    slow = (speed < 0.05).mean()
    assert 0.4 < slow < 0.7, "on the floor for about 58 % of the cycle"


def test_walkers_look_where_they_go():
    joints = somebody("walk", 7).joints(np.arange(0.0, 4.0, 0.01))
    velocity = np.diff(joints[:, J["BodyCenter"], :2], axis=0)
    across = joints[1:, J["lHip"], :2] - joints[1:, J["rHip"], :2]
    forward = np.stack([across[:, 1], -across[:, 0]], axis=-1)
    cosine = (velocity * forward).sum(1) / np.linalg.norm(velocity, axis=1) / np.linalg.norm(forward, axis=1)
    assert cosine.min() > 0.95


def test_left_is_left():
    joints = somebody("stand", 1).joints(np.zeros(1))[0]
    across = joints[J["lShoulder"]] - joints[J["rShoulder"]]
    forward = np.cross(across, [0.0, 0.0, 1.0])
    assert forward @ (joints[J["Nose"]] - joints[J["Neck"]]) > 0.0
    for pair in ("Eye", "Ear", "Hip"):
        assert across @ (joints[J["l" + pair]] - joints[J["r" + pair]]) > 0.0


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 10_000), st.floats(0.15, 0.5), st.floats(0.15, 0.5))
def test_a_limb_reaches_its_target_or_stretches_towards_it(seed, first, second):
    rng = np.random.default_rng(seed)
    start, target, pole = rng.normal(0.0, 0.5, (3, 5, 3))
    middle, end = reach(start, target, pole, first, second)
    distance = np.linalg.norm(target - start, axis=1)
    assert np.linalg.norm(middle - start, axis=1) == pytest.approx(np.full(5, first))
    assert np.linalg.norm(end - middle, axis=1) == pytest.approx(np.full(5, second))
    within = (distance < 0.9 * (first + second)) & (distance > 1.15 * abs(first - second))
    assert np.linalg.norm(end - target, axis=1)[within] == pytest.approx(0.0, abs=2e-3)
    direction = (target - start) / distance[:, None]
    assert (np.cross(end - start, direction) ** 2).sum(1) == pytest.approx(0.0, abs=1e-12)


def test_people_keep_their_distance():
    for seed in range(3):
        people = draw_group(np.random.default_rng(seed), ("walk", "talk", "turn", "reach"), 2.3)
        for t in (0.0, 1.0, 2.5):
            places = np.array([p.joints(np.array([t]))[0, J["BodyCenter"], :2] for p in people])
            gaps = np.linalg.norm(places[:, None] - places[None], axis=-1) + 10 * np.eye(4)
            assert gaps.min() > 0.5


def test_an_unknown_activity_is_named():
    with pytest.raises(UsageError, match="fly"):
        draw_person(np.random.default_rng(0), 0, "fly", 1.7, 1.0)


@pytest.mark.parametrize("seed", range(4))
def test_two_who_embrace_come_close_with_their_arms_round_each_other_and_part(seed):
    two = STAGINGS["embrace"](np.random.default_rng(seed), StagingArea(("walk", "walk"), 2.0, 0.0))
    joints = np.stack([person.joints(np.arange(0.0, 3.4, 0.02)) for person in two])
    middles = joints[:, :, J["BodyCenter"]]
    apart = np.linalg.norm(middles[0] - middles[1], axis=1)
    assert apart[0] > 1.0 and 0.2 < apart.min() < 0.4 and apart[-1] > 1.0
    close = 80  # 1.6 s
    toward = (middles[1, close] - middles[0, close]) / apart[close]
    for person, sign in enumerate((1.0, -1.0)):
        hands = joints[person, close][[J["lWrist"], J["rWrist"]]]
        assert ((hands - middles[person, close]) @ toward * sign > 0.3 * apart[close]).all()
    ankles = joints[:, :, [J["lAnkle"], J["rAnkle"]], 2]
    assert ankles.min() > 0.02
