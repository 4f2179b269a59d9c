"""Which foot carries a body that no camera sees, and where it stays."""

import numpy as np
import pytest
from bodies import CHAIN, MODEL, S, placed

from panoptic_ros.geometry.chain import Pose
from panoptic_ros.geometry.rotations import rotations_of
from panoptic_ros.io.recorded_motions import read_clips
from panoptic_ros.kinematics.body.between import FootContacts
from panoptic_ros.kinematics.config import KinematicsConfig
from panoptic_ros.kinematics.pose.targets import NOTHING_STANDS
from panoptic_ros.simulation.bodies.capture import BodyScene, simulate_body
from panoptic_ros.study.bodies.cases import case_of, prior_without

KNOWN = MODEL, read_clips()
GROUND = np.array([MODEL.index(name) for name in MODEL.ground])
LEFT, RIGHT = MODEL.index("lFoot"), MODEL.index("rFoot")
RATE = 60.0
REST, SWING = (0.3, 0.5), (6.0, 20.0)  # rad/s, m/s^2


def standing(root=(0.0, 0.0, 0.95), knee=0.0):
    """Upright; the left knee bent by so much, rad, with the thigh forward by half of it."""
    vectors = np.zeros((S, 3))
    vectors[MODEL.index("lThigh"), 1], vectors[MODEL.index("lShin"), 1] = -0.5 * knee, knee
    return Pose(np.array(root), rotations_of(vectors))


def told(left, right):
    """Turns and accelerations by segment."""
    return {LEFT: left[0], RIGHT: right[0]}, {LEFT: left[1], RIGHT: right[1]}


def contact():
    return FootContacts(CHAIN.parents, GROUND, RATE)


def side(standing_now):
    return MODEL.names[int(standing_now.segments[0])][0]


def test_a_foot_at_rest_carries_though_the_other_is_lower():
    feet = contact()
    for _ in range(10):
        found = feet.step(CHAIN, standing(knee=1.0), *told(REST, SWING))  # the left one is on a step
    assert side(found) == "l" and found.weights[0] > 0.8 * 0.002**-2


def test_nothing_is_known_well_while_both_feet_move():
    feet = contact()
    for _ in range(10):
        found = feet.step(CHAIN, standing(), *told(SWING, SWING))
    assert found.weights[0] < 0.01 * 0.002**-2


def test_the_lowest_foot_carries_where_no_foot_has_an_imu():
    found = contact().step(CHAIN, standing(knee=1.0), {}, {})
    assert side(found) == "r" and found.weights[0] == pytest.approx(0.002**-2)


def test_nothing_stands_on_a_body_without_feet():
    assert FootContacts(CHAIN.parents, GROUND[:0], RATE).step(CHAIN, standing(), {}, {}) is NOTHING_STANDS


def test_a_body_that_shifts_its_weight_comes_back_to_where_its_feet_stood():
    """Each foot in turn is more at rest; legs are not quite known, so the body slides with the left one."""
    feet, root = contact(), np.zeros(3)
    farthest = 0.0
    for t in range(600):
        phase = 2 * np.pi * t / 60
        left = np.sin(phase) > 0
        found = feet.step(
            CHAIN, standing(root + [0, 0, 0.95]), *told(*((REST, (0.9, 1.0)) if left else ((0.9, 1.0), REST)))
        )
        slid = 0.002 * np.cos(phase) if left else 0.0  # forward with the left one; never back
        root = root + found.moves[0] + [abs(slid), 0, 0]
        farthest = max(farthest, root[0])
    assert farthest < 0.03  # without what is kept of the feet it would be 0.4 m


def test_a_foot_that_slides_slowly_holds_nobody_back():
    feet = contact()
    for t in range(60):
        pose = standing(knee=1.0 + 0.02 * t)  # the left foot rises, and its IMU hardly tells
        found = feet.step(CHAIN, pose, *told((0.5, 1.0), REST))
        if t > 20:
            assert side(found) == "r" and np.linalg.norm(found.moves[0]) < 1e-9


def test_what_was_known_of_the_feet_is_forgotten():
    feet = contact()
    feet.step(CHAIN, standing(), *told(REST, REST))
    feet.forget()
    found = feet.step(CHAIN, standing((3.0, 0.0, 0.95)), *told(REST, REST))
    assert np.all(found.moves == 0.0)


def test_sites_are_where_the_feet_are():
    pose = standing(knee=0.5)
    found = contact().step(CHAIN, pose, *told(REST, SWING))
    places = placed(pose)[1]
    assert places[int(found.segments[0]), 2] == min(places[s, 2] for s in GROUND[:2])


def test_a_walk_on_uneven_ground_does_not_drift():
    take = simulate_body(BodyScene(("03_01",), seconds=7.0, cameras=1), 3, *KNOWN)
    case = case_of(take, prior_without(("03_01", "03_02"), KNOWN[1], KNOWN[0])).with_inputs(0, 13)
    assert case.score(KinematicsConfig(clocks=False))["standing_drift_m"] < 0.15
