"""Balance tells how legs lean where no camera sees; those who do not stand on their feet tell nothing."""

import numpy as np
import pytest

from panoptic_ros.geometry.chain import place_all
from panoptic_ros.geometry.rotations import rotations_of
from panoptic_ros.io.body_models import read_body_model
from panoptic_ros.io.recorded_motions import read_clips
from panoptic_ros.kinematics.config import KinematicsConfig
from panoptic_ros.kinematics.imus.balance import BalanceEstimate, masses_of, t_pose_turns
from panoptic_ros.simulation.bodies.capture import DEVICES, BodyScene, simulate_body
from panoptic_ros.study.bodies.cases import case_of, prior_without

MODEL, CLIPS = read_body_model(), read_clips()
CHAIN = MODEL.body(1.75).chain
SEGMENTS = np.array([MODEL.index(name) for name, _ in DEVICES])
GROUND = np.array([MODEL.index(name) for name in MODEL.ground])
TURNS = t_pose_turns(MODEL.parents, SEGMENTS, np.radians(3.0))


def balance():
    return BalanceEstimate(CHAIN, SEGMENTS, masses_of(MODEL.names), GROUND, TURNS + 1e-6 * np.eye(len(TURNS)))


def standing(lean, knees=0.0, turned=0.0):
    """Places and frames of somebody who leans forwards, rad, as a whole, and turns about the vertical."""
    vectors = np.zeros((1, len(MODEL.names), 3))
    for side in "lr":
        vectors[0, MODEL.index(f"{side}Thigh"), 1] = -knees
        vectors[0, MODEL.index(f"{side}Shin"), 1] = knees
    turns = rotations_of(vectors.reshape(-1, 3)).reshape(1, -1, 3, 3)
    heading, tilt = rotations_of(np.array([[0.0, 0.0, turned], [0.0, lean, 0.0]]))
    turns[0, 0] = heading @ tilt
    places, frames = place_all(CHAIN, np.array([[0.0, 0.0, 1.0]]), turns)
    return places[0], frames[0]


def learnt(at, seconds=10.0, loads=1.0):
    estimate, speed = balance(), np.zeros(2)
    for _ in range(round(seconds / 0.2)):
        corrected = at(estimate.turns)
        estimate.look(*corrected, np.full(len(GROUND), loads), speed, 0.2)
    return np.degrees(estimate.turns)


def test_masses_are_of_a_whole_body():
    assert masses_of(MODEL.names).sum() == pytest.approx(1.0)
    assert not masses_of(("one", "two")).any()


def test_joints_of_a_limb_add_up():
    covariance = t_pose_turns(MODEL.parents, SEGMENTS, 1.0)
    variances = np.diag(covariance)[::3]
    row = {MODEL.names[s]: variances[n] for n, s in enumerate(SEGMENTS)}
    assert (row["hips"], row["lThigh"], row["lShin"], row["lFoot"]) == (1.0, 2.0, 3.0, 4.0)


@pytest.mark.parametrize("turned", [0.0, 2.0])
def test_legs_that_lean_are_turned_back(turned):
    found = learnt(lambda turns: standing(np.radians(8.0) + turns[0, 1], turned=turned))
    row = {MODEL.names[s]: found[n] for n, s in enumerate(SEGMENTS)}
    assert row["hips"][1] < -0.5  # of 8 deg, by what it shares with the legs
    assert row["lThigh"][1] < row["hips"][1] and np.abs(row["lThigh"][[0, 2]]).max() < 0.3


def test_nothing_is_learnt_from_who_sits_or_does_not_stand():
    assert not learnt(lambda _: standing(0.0, knees=1.5)).any()
    assert not learnt(lambda _: standing(0.1), loads=0.1).any()
    assert not learnt(lambda _: standing(0.6)).any()  # leans on something


def test_a_t_pose_is_mended_by_balance_without_cameras(monkeypatch):
    statistics, found = prior_without(("02_10",), CLIPS, MODEL), []
    scene = BodyScene(("02_10",), seconds=9.0, cameras=1, t_pose=2.0, mounts=False)
    case = case_of(simulate_body(scene, 3001, MODEL, CLIPS), statistics).with_inputs(0, 13)
    for masses in (masses_of, lambda names: np.zeros(len(names))):
        monkeypatch.setattr("panoptic_ros.kinematics.imus.devices.masses_of", masses)
        found.append(case.score(KinematicsConfig())["relative_mm"])
    assert found[0] < 0.93 * found[1]
