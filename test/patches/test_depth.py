"""Depth sensors beside the cameras: where the surface is, what is in free space, and who is not believed."""

from collections import Counter
from dataclasses import replace

import captures
import numpy as np
import patch_scene
import pytest

from panoptic_ros.domain import DepthFrame, DepthSensor, TrackedPoseSet
from panoptic_ros.errors import DataError
from panoptic_ros.graph.build import configure, make_stage
from panoptic_ros.patches.depth_buffer import DepthBuffer, SensorDepthMap
from panoptic_ros.patches.depth_maps import in_front
from panoptic_ros.patches.motions import on_surface
from panoptic_ros.stage import StageContext

SENSORS = tuple(
    captures.look_at(f"depth{k}", eye, (-0.85, -0.6, 0.9), focal=75.0, size=(80, 80))
    for k, eye in enumerate(((1.2, 1.5, 1.4), (-2.6, 0.9, 1.4)))
)
RIG = replace(captures.RIG, depth_sensors=tuple(map(DepthSensor, SENSORS)))
CONTEXT = StageContext(RIG, captures.SKELETON)
STILL = (0.0, 0.0, 0.0)
LATE = 13_000_000  # ns, of maps: sensors have clocks of their own
WRIST = captures.SKELETON.joint("lWrist")


def with_depth(count, scale=lambda index: 1.0, wrong=(), last=10**6, shift=(0.02, -0.01, 0.005)):
    """Skeletons, 2D tracks and maps; the left wrist is 30 cm off in front of the body at some instants."""
    items, before, drawn = [], None, []
    for item in patch_scene.recording(count, angle=0.0 if shift is STILL else 0.05, shift=shift):
        if isinstance(item, TrackedPoseSet):
            joints = item.positions[0]
            if before is not None and item.index <= last:
                middle = joints - LATE / patch_scene.STEP * (joints - before)
                stamp = item.stamp_ns - LATE
                if shift is not STILL or not drawn:
                    drawn = [patch_scene.depth_map(sensor, item.index, middle) for sensor in SENSORS]
                for own in drawn:
                    depth = np.float32(scale(item.index)) * own.depth
                    items.append(DepthFrame(own.camera, stamp, item.index, depth))
            before = joints
            if item.index in wrong:
                moved = joints.copy()
                eye = -SENSORS[0].cam_from_world.rotation.T @ SENSORS[0].cam_from_world.translation
                moved[WRIST] += 0.3 * (eye - moved[WRIST]) / np.linalg.norm(eye - moved[WRIST])
                item = patch_scene.skeletons(item.index, moved)
        items.append(item)
    return items


def run(items, context=CONTEXT):
    stage = make_stage("patches", configure({"patches": {"active": True}})["patches"], context)
    given, notices = [], []
    for item in items:
        result = stage.step(item)
        given += result.outputs
        notices += result.notices
    # the log of a node tells them apart by their sensor
    assert all(notice.values["device"] in notice.text for notice in notices)
    return given, [notice.code for notice in notices]


def test_a_joint_in_free_space_is_found_and_no_other():
    given, notices = run(with_depth(12, wrong=(6, 9)))
    assert {item.index: item.free.tolist() for item in given if len(item.free)} == {
        6: [[7, WRIST]],
        9: [[7, WRIST]],
    }
    assert notices == []


def test_refinement_goes_without_joints_in_free_space():
    items, (given, _) = with_depth(12, wrong=(8,)), run(with_depth(12, wrong=(8,)))
    raw = {item.index: item for item in items if isinstance(item, TrackedPoseSet)}
    stage = make_stage("refinement", configure({"refinement": {"lag": 0.0}})["refinement"], CONTEXT)
    truth = {item.index: item.positions[0] for item in patch_scene.recording(12) if hasattr(item, "ids")}
    found = {}
    for item in given:
        stage.step(item)
        found |= {out.index: out.positions[0] for out in stage.step(raw[item.index]).outputs}
    assert np.linalg.norm(found[8][WRIST] - truth[8][WRIST]) < 0.02
    assert np.linalg.norm(raw[8].positions[0, WRIST] - truth[8][WRIST]) == pytest.approx(0.3)


def test_who_lies_is_left_out_said_once_and_taken_back():
    given, notices = run(with_depth(40, lambda index: 1.15 if 8 <= index < 22 else 1.0, shift=STILL))
    assert Counter(notices) == {"patches.depth_lies": 2, "patches.depth_back": 2}
    assert all(not len(item.free) for item in given)
    parts = len(patch_scene.PARTS)
    assert all(len(item.motions.people) == parts for item in given[12:])  # images alone go on


def test_a_sensor_that_always_lies_is_never_used():
    given, notices = run(with_depth(12, lambda index: 1.2, wrong=(6,)))
    assert notices == 2 * ["patches.depth_lies"] and all(not len(item.free) for item in given)
    alone, _ = run([item for item in with_depth(12, wrong=(6,)) if not isinstance(item, DepthFrame)])
    for one, other in zip(given, alone):
        assert np.array_equal(one.positions, other.positions)


def test_a_sensor_that_falls_silent_is_told_once():
    given, notices = run(with_depth(40, last=10, shift=STILL))
    assert notices == 2 * ["patches.depth_silent"] and len(given[-1].motions.people) == len(patch_scene.PARTS)


def test_a_sensor_that_comes_back_is_told_once_and_used_again():
    whole = with_depth(44, wrong=(42,), shift=STILL)
    items = [item for item in whole if not (isinstance(item, DepthFrame) and 6 <= item.frame_number < 40)]
    given, notices = run(items)
    assert notices == 2 * ["patches.depth_silent"] + 2 * ["patches.depth_again"]
    assert [item.index for item in given if len(item.free)] == [42]


def test_maps_of_another_rig_or_size_are_refused():
    stage = make_stage("patches", configure({"patches": {"active": True}})["patches"], CONTEXT)
    with pytest.raises(DataError, match="depth sensor far, which is not in the rig"):
        stage.step(DepthFrame("far", 1, 0, np.ones((80, 80), np.float32)))
    with pytest.raises(DataError, match="has 80 x 70 px, but the rig states 80 x 80"):
        stage.step(DepthFrame("depth0", 1, 0, np.ones((70, 80), np.float32)))


def sensed(depth):
    camera = SENSORS[0]
    rows, columns = np.indices(depth.shape)
    pixels = np.stack([columns, rows], axis=-1).reshape(-1, 2).astype(float)
    return SensorDepthMap(camera, camera.intrinsics.undistort(pixels).reshape(*depth.shape, 2), depth)


def test_a_wall_is_where_it_is_in_a_camera_elsewhere():
    """The wall x = 0.5 before a camera on the x axis, and a sensor aside of it."""
    camera = captures.look_at("cam", (4.0, 0.0, 1.0), (0.0, 0.0, 1.0), focal=300.0, size=(320, 240))
    pose = SENSORS[0].cam_from_world
    flat = np.zeros((80, 80), np.float32)
    rays = np.concatenate([sensed(flat).plane, np.ones((80, 80, 1))], axis=2) @ pose.rotation
    eye = -pose.rotation.T @ pose.translation
    depth = ((0.5 - eye[0]) / rays[..., 0]).astype(np.float32)
    depth = np.where((depth > 0.0) & (depth < 8.0), depth, 0.0).astype(np.float32)
    buffer = DepthBuffer(camera)
    cells = buffer.drawn([sensed(depth)])
    found = buffer.depths(cells, np.array([[0.0, 0.0], [0.1, -0.05], [-0.1, 0.1]]))
    assert found[np.isfinite(found)] == pytest.approx(3.5, abs=0.02) and np.isfinite(found).any()
    assert np.isinf(buffer.depths(cells, np.array([[5.0, 0.0]]))).all()
    view = np.column_stack([camera.cam_from_world.rotation, camera.cam_from_world.translation])
    points, seen = np.array([[0.55, 0.0, 1.0], [0.0, 0.0, 1.0], [0.9, 0.0, 1.0]]), np.ones(3, bool)
    on_surface(buffer, [sensed(depth)], view, np.array([4.0, 0.0, 1.0]), points, seen)
    assert points[0, 0] == pytest.approx(0.5, abs=0.02)  # near it: put on it
    assert seen.tolist() == [True, False, False]  # behind it, and where it is not


def test_holes_are_not_free():
    camera = SENSORS[0]
    pose = camera.cam_from_world
    ahead = np.array([[0.0, 0.0, 2.0], [0.0, 0.0, 2.97], [0.0, 0.0, 2.99]])
    points = (ahead - pose.translation) @ pose.rotation
    depth = np.full((80, 80), 3.0, np.float32)
    assert in_front(sensed(depth), points).tolist() == [True, True, False]
    depth[36:45, 36:45] = 0.0
    assert not in_front(sensed(depth), points).any()
    depth[36:45, 36:45] = 3.0
    depth[41, 41] = 2.5  # the nearest in the window counts
    assert in_front(sensed(depth), points).tolist() == [True, False, False]
