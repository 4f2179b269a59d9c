"""Mountings: poor ones are mended, good ones kept, and what is known of them is not overstated."""

from dataclasses import replace

import numpy as np
import pytest

from panoptic_ros.geometry.rotations import rotations_of
from panoptic_ros.kinematics.config import KinematicsConfig
from panoptic_ros.kinematics.session import solve_recording
from panoptic_ros.running.bodies import read_body_model, read_clips
from panoptic_ros.running.studies.bodies import prior_without, recording_of, score_capture
from panoptic_ros.simulation.bodies.capture import BodyScene, simulate_body

MODEL, CLIPS = read_body_model(), read_clips()
PRIOR = prior_without(("02_05",), CLIPS, MODEL)
OURS, FIXED = KinematicsConfig(clocks=False), KinematicsConfig(clocks=False, mounting=False)


def capture(**changes):
    return simulate_body(BodyScene(("02_05",), seconds=8.0, cameras=6, **changes), 9, MODEL, CLIPS)


def test_a_poor_t_pose_is_mended():
    take = capture(mounts=False, t_pose=4.0)
    ours, fixed = score_capture(take, OURS, PRIOR), score_capture(take, FIXED, PRIOR)
    assert ours["mm"] < 0.8 * fixed["mm"] and ours["deg"] < 0.9 * fixed["deg"]


def test_a_good_mounting_is_kept():
    take = capture()
    ours, fixed = score_capture(take, OURS, PRIOR), score_capture(take, FIXED, PRIOR)
    assert ours["mm"] < fixed["mm"] + 0.5 and ours["deg"] < fixed["deg"] + 0.3


@pytest.mark.parametrize("turn", [0.0, 35.0])
def test_a_device_put_on_wrong_is_found(turn):
    take = capture()
    k = next(n for n, d in enumerate(take.subject.devices) if MODEL.names[d.segment] == "lThigh")
    devices = list(take.subject.devices)
    off = rotations_of(np.radians([[0.0, turn, 0.0]]))[0]
    devices[k] = replace(devices[k], mount=off @ devices[k].mount)
    subject = replace(take.subject, devices=tuple(devices))
    solved = solve_recording(recording_of(take), [subject], OURS, PRIOR)
    found = np.degrees(solved.trackers[0].mounting.mountings[k])
    assert np.linalg.norm(found - [0.0, turn, 0.0]) < 12.0
