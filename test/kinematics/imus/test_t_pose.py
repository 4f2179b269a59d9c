"""The heading of IMUs without cameras: found again from recorded motion, whatever it was."""

import math
from dataclasses import replace

import numpy as np
import pytest
from bodies import BODY, MODEL

from panoptic_ros.domain.subjects import BodyState, Device, Subject, TPose
from panoptic_ros.geometry.chain import place_all
from panoptic_ros.geometry.rotations import rotations_of, turn_about_z
from panoptic_ros.io.pose_prior import read_prior
from panoptic_ros.io.recorded_motions import read_clips
from panoptic_ros.kinematics.config import KinematicsConfig
from panoptic_ros.kinematics.imus.fitting import KEPT_S, ImuFitting
from panoptic_ros.kinematics.imus.measured import ImuMeasurements
from panoptic_ros.kinematics.imus.t_pose import heading_from_poses, t_pose_decides

WORN = ("hips", "spine4", "lUpperArm", "lForearm", "rUpperArm", "rForearm", "lThigh", "lShin", "rThigh")


def measured(heading, facing, vectors, worn=WORN):
    """Somebody with devices put on anyhow: the subject, and orientations in motion and in the T-pose."""
    rng = np.random.default_rng(3)
    turns = rotations_of(np.ascontiguousarray(vectors.reshape(-1, 3))).reshape(*vectors.shape[:2], 3, 3)
    frames = place_all(BODY.chain, np.zeros((len(turns), 3)), turns)[1]
    back, stood = turn_about_z(-heading), turn_about_z(math.atan2(facing[1], facing[0]))
    devices, moved, held = [], {}, {}
    for name in worn:
        mount, s = np.linalg.qr(rng.normal(size=(3, 3)))[0], MODEL.index(name)
        mount *= np.linalg.det(mount)
        devices.append(Device(name, s, np.zeros(3), None))
        moved[name] = back @ frames[:, s] @ mount
        held[name] = np.tile(back @ stood @ mount, (5, 1, 1))
    pose = TPose(0, 1, np.array(facing))
    return Subject(0, BODY, tuple(devices), t_pose=pose, heading_known=False), moved, held


@pytest.mark.parametrize("facing", [(1.0, 0.0, 0.0), (0.0, -1.0, 0.0)])
@pytest.mark.parametrize("heading", [0.3, 2.5, -1.9])
def test_it_is_found_again(heading, facing):
    vectors = read_clips()["02_05"].vectors
    subject, moved, held = measured(heading, facing, vectors)
    moved["lShin"][::7] = np.nan
    found = heading_from_poses(subject, read_prior(""), moved, held)
    assert t_pose_decides(subject) and abs(math.remainder(found - heading, 2 * math.pi)) < math.radians(6.0)


def test_nobody_moves_or_one_device_tells_nothing():
    vectors = np.zeros((100, len(MODEL.names), 3))
    assert heading_from_poses(*_with_prior(measured(0.3, (1.0, 0.0, 0.0), vectors))) is None
    vectors = read_clips()["02_05"].vectors
    assert heading_from_poses(*_with_prior(measured(0.3, (1.0, 0.0, 0.0), vectors, ("hips",)))) is None


def felt(turns):
    """All devices, of these orientations."""
    return ImuMeasurements(np.ones(len(turns), bool), np.array(turns), np.full((len(turns), 3), np.nan))


def test_live_it_is_told_some_seconds_after_the_t_pose():
    subject, moved, held = measured(0.7, (1.0, 0.0, 0.0), read_clips()["02_05"].vectors)
    fitting, told, statistics = ImuFitting(KinematicsConfig(), subject), [], read_prior("")
    rate = 60.0
    for k in range(300):
        turns = {name: held[name][0] if k == 0 else own[k] for name, own in moved.items()}
        stamp = round(k * 1e9 / rate)
        told += fitting.take(stamp, subject, felt([turns[device.name] for device in subject.devices]))
        told += fitting.learn(subject, [], rate, statistics)
        assert bool(fitting.mounts(stamp, subject)) == (fitting.heading is not None)
        if told:
            break
    assert [notice.code for notice in told] == ["kinematics.imu_aligned"] and "40 deg" in told[0].text
    assert not fitting.looking and abs(fitting.heading - 0.7) < math.radians(6.0)


def test_samples_are_bounded_while_a_t_pose_lies_ahead():
    subject, moved, _ = measured(0.0, (1.0, 0.0, 0.0), np.zeros((1, len(MODEL.names), 3)))
    subject = replace(subject, t_pose=replace(subject.t_pose, from_ns=10**15, to_ns=10**15 + 1))
    fitting, statistics, rate = ImuFitting(KinematicsConfig(), subject), read_prior(""), 2.0
    rows = felt([moved[device.name][0] for device in subject.devices])
    for k in range(round(2.0 * KEPT_S * rate)):
        fitting.take(round(k * 1e9 / rate), subject, rows)
        assert fitting.learn(subject, [], rate, statistics) == []
    lengths = {len(kept) for kept in (fitting._stamps, fitting._turns, fitting._forces)}
    assert fitting.looking and max(lengths) == min(lengths) <= (KEPT_S + 1.0) * rate


def _with_prior(given):
    subject, moved, held = given
    return subject, read_prior(""), moved, held


@pytest.mark.parametrize("solved_hz", [60.0, 20.0])
def test_a_late_node_looks_no_longer_than_a_punctual_one(solved_hz):
    subject, moved, _ = measured(0.0, (1.0, 0.0, 0.0), np.zeros((1, len(MODEL.names), 3)))
    fitting, statistics, rate, told = ImuFitting(KinematicsConfig(), subject), read_prior(""), 60.0, []
    turns = [moved[device.name][0] for device in subject.devices]
    places, frames = place_all(BODY.chain, np.zeros((1, 3)), np.tile(np.eye(3), (1, len(MODEL.names), 1, 1)))
    for k in range(round(16.0 * rate)):
        stamp = round(k * 1e9 / rate)
        fitting.take(stamp, subject, felt(turns))
        if fitting.looking and k % round(rate / solved_hz) == 0:
            told += fitting.learn(subject, [BodyState(stamp, 0, places[0], frames[0])], rate, statistics)
        assert fitting.looking == (stamp < 14.9e9) or 14.9e9 <= stamp <= 15.1e9
    assert [notice.code for notice in told] == ["kinematics.imu_heading"]
