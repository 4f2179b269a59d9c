"""Joints in motion, seen by cameras at different times, with exact truth."""

from dataclasses import replace

import numpy as np
import pytest
from fed_stages import FedAssembly, seen_by
from rolling import rolling_points, with_line_delays

DELAYS = (-0.014, 0.009, -0.003, 0.012, 0.004)  # s, of the cameras
VELOCITY = np.array([1.1, -0.6, 0.3])  # m/s
RATE = 30.0


def moving(scenes, rig, count, noise=0.0, velocity=VELOCITY, delays=DELAYS):
    """Sets of somebody whose joints all move alike, each view at its own time, and where the joints are."""
    sets, truth = [], []
    for index in range(count):
        views, whole = [], None
        for k, delay in enumerate(delays):
            place = scenes.person() + velocity * (index / RATE + delay)
            whole = scenes.proposals(rig, [place], index=index, noise=noise, seed=k, rate=RATE)
            view = whole.detections.views[k]
            views.append(replace(view, stamp_ns=whole.stamp_ns + round(1e9 * delay)))
        sets.append(seen_by(whole, tuple(views)))
        truth.append(scenes.person() + velocity * index / RATE)
    return sets, truth


def poses(scenes, rig, sets, **settings):
    stage = FedAssembly(scenes.context(rig), **settings)
    return [stage.step(item).outputs[0] for item in sets]


@pytest.mark.parametrize("guidance", [True, False])
def test_positions_depend_on_motion_as_stated(scenes, guidance):
    rig = scenes.ring(len(DELAYS))
    sets, truth = moving(scenes, rig, 4)
    for pose, joints in zip(poses(scenes, rig, sets, temporal_guidance=guidance), truth):
        shift = pose.time_shift
        moved = (shift.delays[0] @ (VELOCITY - shift.assumed[0])[..., None])[..., 0]
        assert np.abs(pose.positions[0] - moved - joints).max() < 2e-3
        assert np.abs(shift.velocities[0] - VELOCITY).max() < 0.2
        assert pose.newest_ns - pose.stamp_ns == round(1e9 * max(DELAYS))


def test_a_velocity_that_is_assumed_right_needs_no_correction(scenes):
    rig = scenes.ring(len(DELAYS))
    sets, truth = moving(scenes, rig, 12)
    pose = poses(scenes, rig, sets)[-1]
    assert np.abs(pose.time_shift.assumed[0] - VELOCITY).max() < 0.05
    assert np.abs(pose.positions[0] - truth[-1]).max() < 1e-3


def test_stated_information_of_velocities_is_honest(scenes):
    rig = scenes.ring(len(DELAYS))
    sets, _ = moving(scenes, rig, 120, noise=2.0)
    squares = []
    for pose in poses(scenes, rig, sets)[40:]:
        offset = pose.time_shift.velocities[0] - VELOCITY
        squares.append(np.einsum("ji,jik,jk->j", offset, pose.time_shift.information[0], offset) / 3.0)
    assert 0.7 < np.mean(squares) < 1.5


def test_equal_stamps_have_no_shift(scenes):
    rig = scenes.ring(3)
    sets, _ = moving(scenes, rig, 2, delays=(0.0, 0.0, 0.0))
    for pose in poses(scenes, rig, sets):
        assert pose.time_shift is None and pose.newest_ns == pose.stamp_ns


@pytest.mark.parametrize("first_rows_s", [0.0, -0.5 * 959 * 30e-6])
def test_rows_of_rolling_shutters_are_different_instants(scenes, first_rows_s):
    """Also where the middle rows of all views are exposed at the instant of the set."""
    rig, sets, truth = with_line_delays(scenes.ring(5), (30.0,)), [], []
    for index in range(12):
        whole = scenes.proposals(rig, [scenes.person()], index=index, rate=RATE)
        truth.append(scenes.person() + VELOCITY * index / RATE)

        def joints_at(seconds, now=truth[-1]):
            return (now + VELOCITY * seconds)[None]

        points = [rolling_points(camera, joints_at, first_rows_s) for camera in rig.cameras]
        stamp = whole.stamp_ns + round(1e9 * first_rows_s)
        views = [replace(v, stamp_ns=stamp, points=own) for v, own in zip(whole.detections.views, points)]
        sets.append(seen_by(whole, views))
    pose = poses(scenes, rig, sets)[-1]
    assert np.abs(pose.time_shift.assumed[0] - VELOCITY).max() < 0.05
    assert np.abs(pose.positions[0] - truth[-1]).max() < 1e-3


def test_noise_of_joints_that_move_is_learnt_like_that_of_those_that_rest(scenes):
    rig = scenes.ring(len(DELAYS))
    spreads = []
    for velocity in (np.zeros(3), VELOCITY):
        sets, _ = moving(scenes, rig, 30, noise=2.0, velocity=velocity)
        last = poses(scenes, rig, sets)[-1]
        spreads.append(np.sqrt(np.trace(last.covariances[0], axis1=1, axis2=2)).mean())
    assert spreads[1] < 1.15 * spreads[0]
