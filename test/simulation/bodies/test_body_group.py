"""Several people in one simulated capture: who is asked for, what is unknown, what detectors make of them."""

from dataclasses import replace

import numpy as np
import pytest

from panoptic_ros.geometry.rotations import from_quaternions, turn_about_z, vectors_of
from panoptic_ros.geometry.rotations import rotations_of as from_vectors
from panoptic_ros.io.body_models import read_body_model
from panoptic_ros.io.recorded_motions import read_clips
from panoptic_ros.running.simulations.body_scenes import BODY_SCENES, OTHER_BODY_SCENES, body_scene
from panoptic_ros.simulation.bodies.capture import BodyScene, simulate_body
from panoptic_ros.simulation.bodies.group import FIRST_STRANGER, simulate_group
from panoptic_ros.simulation.bodies.motion import laid_out

MODEL, CLIPS = read_body_model(), read_clips()


@pytest.fixture(scope="module")
def crowd():
    return simulate_group(replace(body_scene("body-crowd"), seconds=4.0, cameras=3), 5, MODEL, CLIPS)


def test_the_designated_have_devices_of_their_own_and_strangers_none(crowd):
    first, second = crowd.subjects
    worn = [{device.name for device in subject.devices} for subject in (first, second)]
    assert not worn[0] & worn[1] and worn[0] | worn[1] == set(crowd.devices)
    assert {state.id for state in crowd.truth} == {first.id, second.id}
    assert all(state.id >= FIRST_STRANGER for state in crowd.strangers)
    assert len({state.id for state in crowd.strangers}) == 2
    for subject in crowd.subjects:
        begin = next(state for state in crowd.truth if state.id == subject.id)
        np.testing.assert_allclose(subject.start, begin.places[0], atol=0.01)


def test_a_t_faces_where_the_file_says(crowd):
    for subject in crowd.subjects:
        begin = next(state for state in crowd.truth if state.id == subject.id)
        assert np.degrees(np.arccos(begin.frames[0, :, 0] @ subject.t_pose.facing)) < 15


def test_views_hold_people_in_no_order_with_gaps_and_ghosts(crowd):
    counts = [len(points) for view in crowd.views for points, _ in view]
    assert min(counts) < 4 < max(counts) and 3.5 < np.mean(counts) < 4.2
    for points, scores in crowd.views[0]:
        np.testing.assert_array_equal(np.isfinite(points).all(-1), scores > 0.0)


def test_frames_and_clocks_are_off_by_what_is_drawn():
    scene = replace(body_scene("body-clocks"), seconds=3.0, cameras=1)
    known = simulate_body(replace(scene, clock=0.0), 5, MODEL, CLIPS)
    off = simulate_body(replace(scene, heading=180.0), 5, MODEL, CLIPS)
    late = {int(off.devices[name].stamps[0] - known.devices[name].stamps[0]) for name in known.devices}
    assert len(late) == 1 and 0 < abs(late.pop()) <= 60_000_000
    turned = from_quaternions(off.devices["imu04"].quaternions[:1])[0]
    between = vectors_of((turned @ from_quaternions(known.devices["imu04"].quaternions[0]).T)[None])[0]
    np.testing.assert_allclose(between[:2], 0, atol=1e-9)
    assert abs(between[2]) > 0.1 and not off.subject.heading_known and known.subject.heading_known


def test_clips_of_a_path_go_on_where_the_one_before_ended():
    clip = CLIPS["02_01"]
    there, back = laid_out([clip, clip], (0.0, 180.0))
    np.testing.assert_allclose(back.roots[0, :2], there.roots[-1, :2], atol=1e-9)
    np.testing.assert_allclose(back.roots[-1, :2], there.roots[0, :2], atol=1e-9)
    np.testing.assert_allclose(
        from_vectors(back.vectors[:, 0]), turn_about_z(np.pi) @ from_vectors(there.vectors[:, 0]), atol=1e-9
    )


def test_somebody_alone_is_the_same_as_without_a_group():
    scene = BodyScene(seconds=3.0, cameras=2)
    alone, group = simulate_body(scene, 2, MODEL, CLIPS), simulate_group(scene, 2, MODEL, CLIPS)
    np.testing.assert_array_equal(group.views[1][7][0][0], alone.pixels[1, 7])
    assert not group.strangers and len(group.subjects) == 1
    np.testing.assert_array_equal(group.subjects[0].devices[3].mount, alone.subject.devices[3].mount)


@pytest.mark.parametrize("name", [*BODY_SCENES, *OTHER_BODY_SCENES])
def test_every_scene_has_its_clips(name):
    scene = body_scene(name)
    assert all(clip in CLIPS for one in (scene, *scene.others) for clip in one.clips)
