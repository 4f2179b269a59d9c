"""Mountings and lengths: poor ones are mended, good ones kept; what is out of order is told."""

from dataclasses import replace

import numpy as np
import pytest

from panoptic_ros.geometry.rotations import from_quaternions, rotations_of, to_quaternions
from panoptic_ros.io.body_models import read_body_model
from panoptic_ros.io.recorded_motions import read_clips
from panoptic_ros.kinematics.config import KinematicsConfig
from panoptic_ros.kinematics.imus.devices import unseen_axes
from panoptic_ros.kinematics.session import solve_recording
from panoptic_ros.simulation.bodies.capture import BodyScene, simulate_body, sparse
from panoptic_ros.simulation.bodies.imus import unknown_heading
from panoptic_ros.study.bodies.cases import case_of, prior_without, recording_of

MODEL, CLIPS = read_body_model(), read_clips()
PRIOR = prior_without(("02_05",), CLIPS, MODEL)
OURS, FIXED = KinematicsConfig(clocks=False), KinematicsConfig(clocks=False, mounting=False)


def capture(**changes):
    return simulate_body(BodyScene(("02_05",), seconds=8.0, cameras=4, **changes), 9, MODEL, CLIPS)


def score(take, config):
    return case_of(take, PRIOR).score(config)


@pytest.fixture(scope="module")
def good():
    return capture()


@pytest.fixture(scope="module")
def poor():
    return capture(mounts=False, t_pose=4.0)


@pytest.fixture(scope="module")
def solved(good):
    return score(good, OURS)


def test_a_poor_t_pose_is_mended(poor):
    ours, fixed = score(poor, OURS), score(poor, FIXED)
    assert ours["mm"] < 0.8 * fixed["mm"] and ours["deg"] < 0.9 * fixed["deg"]


def test_a_good_mounting_is_kept(good, solved):
    ours, fixed = solved, score(good, FIXED)
    assert ours["mm"] < fixed["mm"] + 0.5 and ours["deg"] < fixed["deg"] + 0.3


def worn_on(take, name):
    return next(n for n, d in enumerate(take.subject.devices) if MODEL.names[d.segment] == name)


def told(take, subject=None, devices=None):
    """What is told of a capture, and the tracker at its end."""
    take = replace(take, devices={**take.devices, **(devices or {})})
    solved = solve_recording(recording_of(take), [subject or take.subject], OURS, PRIOR)
    return solved.notices, solved.people[0].tracker


@pytest.mark.parametrize("turn", [0.0, 30.0])
def test_a_device_put_on_wrong_is_found(good, turn):
    k = worn_on(good, "lThigh")
    devices = list(good.subject.devices)
    off = rotations_of(np.radians([[0.0, turn, 0.0]]))[0]
    devices[k] = replace(devices[k], mount=off @ devices[k].mount)
    notices, tracker = told(good, replace(good.subject, devices=tuple(devices)))
    assert np.linalg.norm(np.degrees(tracker.mounting.mountings[k]) - [0.0, turn, 0.0]) < 9.0
    assert len(notices) == (turn > 0.0)
    if turn:
        assert notices[0].startswith(f"subject 0: {devices[k].name} sits on lThigh about")


def test_one_camera_convicts_no_device(good):
    k = worn_on(good, "lThigh")
    devices = list(good.subject.devices)
    devices[k] = replace(devices[k], mount=rotations_of(np.radians([[0.0, 40.0, 0.0]]))[0] @ devices[k].mount)
    notices, tracker = told(sparse(good, [2], 13), replace(good.subject, devices=tuple(devices)))
    assert not notices and abs(np.degrees(tracker.mounting.heading)) < 5.0


def test_two_exchanged_devices_are_told_and_taken_for_each_other(good):
    left, right = (good.subject.devices[worn_on(good, name)].name for name in ("lForearm", "rForearm"))
    swapped = {left: good.devices[right], right: good.devices[left]}
    notices, tracker = told(good, devices=swapped)
    assert notices == [f"subject 0: {left} is on rForearm, and {right} on lForearm: the two are swapped"]
    assert np.degrees(np.abs(tracker.mounting.mountings)).max() < 20.0


def slipped(take, name, turn):
    """What is told where the device of a segment turns after 5 s, by a rotation vector in deg."""
    device = take.subject.devices[worn_on(take, name)]
    series = take.devices[device.name]
    late = series.stamps > series.stamps[0] + 5_000_000_000
    turned = from_quaternions(series.quaternions)
    turned[late] = turned[late] @ device.mount.T @ rotations_of(np.radians([turn]))[0] @ device.mount
    notices, _ = told(take, devices={device.name: replace(series, quaternions=to_quaternions(turned))})
    return [notice.replace(device.name, "it") for notice in notices]


@pytest.mark.parametrize("name", ["rThigh", "lForearm"])
def test_a_slipped_strap_is_told(good, name):
    told_first = slipped(good, name, [25.0, 0.0, 5.0])[0]
    assert told_first == f"subject 0: it has slipped on {name}; its mounting is estimated again"


def test_what_cameras_do_not_see_is_no_slip(good):
    assert slipped(good, "lForearm", [0.0, 25.0, 0.0]) == []  # about the bone


def test_a_heading_that_is_off_is_told_and_corrected(good):
    turned = {name: unknown_heading(series, np.radians(10.0)) for name, series in good.devices.items()}
    notices, tracker = told(good, devices=turned)
    assert len(notices) == 1 and "the heading of the IMUs is about" in notices[0]
    assert abs(np.degrees(tracker.mounting.heading) - 10.0) < 5.0


def test_where_a_t_pose_tells_mountings_nothing_is_said_about_the_heading(poor):
    turned = {name: unknown_heading(series, np.radians(12.0)) for name, series in poor.devices.items()}
    assert not any("heading" in notice for notice in told(poor, devices=turned)[0])


def test_cameras_do_not_see_forearms_turn_about_themselves():
    blind = unseen_axes(MODEL.body(1.75))
    assert {MODEL.names[s] for s in np.flatnonzero(blind.any(1))} == {"lForearm", "rForearm"}


def test_lengths_are_learnt_from_motion(good, solved):
    body = MODEL.body(good.stature)
    known = {name: (MODEL.names[s], o) for name, (s, o) in good.subject.body.keypoints.items()}
    unmeasured = replace(good.subject, body=body.with_keypoints(known), measured=False)
    take = replace(good, subject=unmeasured)
    learnt = score(take, OURS)["mm"]
    stature = score(take, replace(OURS, lengths=False))["mm"]
    assert learnt < solved["mm"] + 5.0 < stature
