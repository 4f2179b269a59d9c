"""Calibration from simulated people: exact without noise, as certain as stated with it, clocks, refusals."""

import re
from dataclasses import replace

import numpy as np
import pytest

from panoptic_ros.calibration.bundle import residuals_of
from panoptic_ros.calibration.essential import epipolar_residuals, essential_of
from panoptic_ros.calibration.people.excerpts import MOST_SEGMENTS, SEGMENT_S, excerpt_of
from panoptic_ros.calibration.people.frame import Bodies, body_axis, scale_of, scaled
from panoptic_ros.calibration.people.identities import identities_of
from panoptic_ros.calibration.people.pairs import TrackletMatch
from panoptic_ros.calibration.people.quality import doubts_of_people
from panoptic_ros.calibration.people.sightings import sightings_at
from panoptic_ros.calibration.people.solve import used_joints
from panoptic_ros.calibration.people.tracklets import Tracklet, image_velocities, link_camera
from panoptic_ros.domain.bone_shares import SHARES, STATURE_M, bones_of, log_scale
from panoptic_ros.errors import CalibrationError
from panoptic_ros.geometry import Intrinsics, Rigid
from panoptic_ros.geometry.rotations import rotations_of
from panoptic_ros.running.calibration.calibrate_people import calibrate_views
from panoptic_ros.simulation.degradation import CLEAN, MILD
from panoptic_ros.simulation.people_sessions import PeopleScene, simulate_people
from panoptic_ros.simulation.rigs import Corners, Ring
from panoptic_ros.simulation.skeleton import SKELETON
from panoptic_ros.stage import untold
from panoptic_ros.study.calibration.people import _grid, _own_errors, _session_errors

EXACT = replace(CLEAN, noise_px=1e-3, hidden_miss=1.0)
SCENE = PeopleScene(Corners(3), degradation=MILD, seconds=3.0, rate_hz=15.0)
LENS = Intrinsics(np.diag([1000.0, 1000.0, 1.0]), np.zeros(5))
JOINTS = used_joints(SKELETON)


def calibrated(scene, seed=0, **options):
    session = simulate_people(scene, seed)
    return session, calibrate_views(session.rig, session.views, SKELETON, untold, **options)


@pytest.fixture(scope="module")
def usual():
    return calibrated(SCENE, 1)


def test_exact_joints_give_the_exact_rig_up_to_scale():
    session, found = calibrated(replace(SCENE, degradation=EXACT), synchronous=True)
    errors = _own_errors(found, session.rig, _grid())
    assert errors["error_m"] < 2e-5
    assert errors["rotation_rad"] < 1e-5
    assert errors["up_rad"] < 0.01


def test_errors_are_as_large_as_stated(usual):
    rows = []
    for session, found in (usual, calibrated(SCENE, 2)):
        rows.append({**_own_errors(found, session.rig, _grid()), **_session_errors(found, session)})
    mean = {name: np.mean([row[name] for row in rows]) for name in rows[0]}
    assert mean["error_m"] < 2e-3
    assert mean["up_rad"] < np.radians(0.5)
    assert 0.2 < mean["nees"] < 3.0
    assert mean["joints"] < 1.1


def test_constant_biases_of_the_detector_are_in_the_covariance():
    biased = replace(SCENE, rig=Ring(5), degradation=EXACT, bias_m=0.015)
    session, found = calibrated(biased, synchronous=True)
    assert _session_errors(found, session)["nees"] < 5.0
    assert found.quality.rig.error_m > 1e-3


def test_clock_offsets_are_found():
    session, found = calibrated(replace(SCENE, rig=Corners(4), lag_s=0.05, rate_hz=30.0))
    offsets = found.solved.rig.state.cameras.offsets
    np.testing.assert_allclose(offsets, session.offsets - session.offsets[0], atol=4e-3)
    assert _own_errors(found, session.rig, _grid())["error_m"] < 3e-3


def test_a_measured_distance_gives_the_scale(usual):
    session, found = usual
    cameras = np.stack([camera.centre for camera in session.rig.cameras])
    metres = float(np.linalg.norm(cameras[0] - cameras[1]))
    scale = scale_of(found.solved, None, (0, 1, metres))
    centres = np.stack([camera.centre for camera in found.rig.cameras])
    assert scale.factor * np.linalg.norm(centres[0] - centres[1]) == pytest.approx(metres)
    assert not any("makes people" in line for line in doubts_of_people(found.quality._replace(scale=scale)))
    wrong = scale_of(found.solved, None, (0, 1, 1.5 * metres))
    assert any("makes people" in line for line in doubts_of_people(found.quality._replace(scale=wrong)))


def test_the_stature_scales_the_rig(usual):
    found = usual[1]
    mean, tall = (scale_of(found.solved, stature, None) for stature in (STATURE_M, 2.0))
    assert tall.factor / mean.factor == pytest.approx(2.0 / STATURE_M)
    assert mean.factor == pytest.approx(1.0, abs=1e-9)  # the usual scale is applied already
    assert mean.sd < found.quality.scale.sd


def test_joints_of_the_scaled_rig_are_where_its_cameras_see_them(usual):
    solved = scaled(usual[1].solved, 2.0)
    before, after = (residuals_of(one.rig.seen, one.rig.state) for one in (usual[1].solved, solved))
    np.testing.assert_allclose(after, before, atol=1e-6)


@pytest.mark.parametrize(
    ("scene", "text"),
    [
        (replace(SCENE, activities=("stand",), rig=Corners(4)), "stays on the spot"),
        (replace(SCENE, rig=Corners(1)), "two cameras or more"),
        (replace(SCENE, seconds=0.4), "nobody is seen"),
    ],
)
def test_what_does_not_determine_the_rig_is_refused(scene, text):
    with pytest.raises(CalibrationError, match=text):
        calibrated(scene)


def test_cameras_without_common_people_are_named():
    session = simulate_people(SCENE, 0)
    half = session.views[0].stamp_ns + 1_500_000_000
    last = session.rig.cameras[2].name
    views = [view for view in session.views if (view.stamp_ns < half) != (view.camera == last)]
    with pytest.raises(CalibrationError, match=f"camera {last} never sees the same people"):
        calibrate_views(session.rig, views, SKELETON, untold)


def tracklet(camera, stamps, shift=0.0):
    points = np.zeros((len(stamps), len(JOINTS), 2)) + np.asarray(stamps)[:, None, None] * 100.0 + shift
    points += 20.0 * np.arange(len(JOINTS))[:, None]
    return Tracklet(camera, LENS, np.asarray(stamps), points, np.ones(points.shape[:2]))


def test_velocities_withstand_exchanged_sides():
    stamps = np.arange(30) / 30.0
    points = np.stack([300.0 * stamps, -100.0 * stamps], axis=1)[:, None]
    points[[7, 18, 24]] += 40.0
    speeds = image_velocities(stamps, points)[:, 0]
    np.testing.assert_allclose(speeds[3:-3], np.tile([300.0, -100.0], (24, 1)), rtol=0.3, atol=20.0)
    np.testing.assert_allclose(np.median(speeds, axis=0), [300.0, -100.0], atol=1e-6)


def test_frames_stand_for_instants_after_the_offset_of_their_camera():
    own = tracklet(0, np.arange(20) / 30.0)
    seen = sightings_at([own], np.array([0.1, 0.3]), np.array([0.01]))
    np.testing.assert_allclose(own.stamps[[3, 9]] - seen.instants, seen.late[0], atol=1e-12)
    shifted = (own.points[3, 0] - 100.0 * 0.01) / 1000.0
    np.testing.assert_allclose(seen.plane[0, 0, 0], shifted, atol=1e-9)


def test_two_people_stay_two_tracklets_and_ambiguous_ones_end():
    session = simulate_people(replace(SCENE, degradation=EXACT), 2)
    camera = session.rig.cameras[0]
    views = [view for view in session.views if view.camera == camera.name]
    found = link_camera(0, views, views[0].stamp_ns, JOINTS, camera.intrinsics)
    for own in found:
        true = [one.joints(own.stamps)[:, JOINTS] for one in session.people]
        pixels = [camera.project(points)[0] for points in true]
        misses = [np.nanmax(np.abs(own.points - points)) for points in pixels]
        assert min(misses) < 1.0


def test_a_match_that_gives_a_person_two_places_is_refused():
    stamps = np.arange(10) / 10.0
    seen = sightings_at(
        [tracklet(0, stamps), tracklet(0, stamps, 300.0), tracklet(1, stamps), tracklet(2, stamps)],
        stamps,
        np.zeros(3),
    )
    people = identities_of(
        seen, [TrackletMatch(0, 2, 9.0), TrackletMatch(1, 2, 5.0), TrackletMatch(1, 3, 4.0)]
    )
    assert people.tolist() == [0, 1, 0, 1]


def test_epipolar_residuals_are_0_for_points_and_distances_off_their_lines():
    pose = Rigid(rotations_of(np.array([[0.1, -0.4, 0.2]]))[0], np.array([1.0, 0.2, -0.1]))
    points = np.random.default_rng(0).uniform(-1.0, 1.0, (20, 3)) + [0.0, 0.0, 4.0]
    other = pose.apply(points)
    first, second = points[:, :2] / points[:, 2:], other[:, :2] / other[:, 2:]
    essential = essential_of(pose)
    np.testing.assert_allclose(epipolar_residuals(essential, first, second), 0.0, atol=1e-12)
    assert epipolar_residuals(essential, first, second + 0.01).max() > 1e-3


def test_bones_give_the_scale():
    bones = bones_of(SKELETON, JOINTS)
    assert len(bones.lengths) == 2 * len(SHARES)
    session = simulate_people(SCENE, 0)
    joints = session.people[0].joints(session.times)[:, JOINTS]
    scale = np.exp(log_scale(0.1 * joints, bones))
    expected = 10.0 * STATURE_M / session.people[0].body.height
    assert scale == pytest.approx(expected, rel=0.05)


def test_people_who_sit_are_told_from_people_who_stand():
    for activity, standing in (("walk", True), ("sit", False)):
        person = simulate_people(replace(SCENE, activities=(activity,)), 0).people[0]
        joints = person.joints(np.arange(0.0, 5.0, 0.2))[:, JOINTS]
        axis, sd = body_axis(Bodies(joints[None], np.zeros((1, *joints.shape[:2]))))
        assert (sd < 0.1) == standing
        assert axis[2] > 0.9


def test_the_parts_with_most_motion_are_used():
    still = [tracklet(0, np.arange(k, k + SEGMENT_S, 0.1)) for k in range(0, 100, 5)]
    still = [replace(own, points=np.tile(own.points[:1], (len(own.stamps), 1, 1))) for own in still]
    moving = [tracklet(0, np.arange(60.0, 65.0, 0.1))]
    found = excerpt_of(still + moving, 1)
    assert any(own.stamps[0] >= 60.0 and np.ptp(own.points[:, 0]) > 0.0 for own in found.tracklets)
    assert len(found.dense) <= 1.1 * MOST_SEGMENTS * SEGMENT_S * 10


def zoomed(rig, factors):
    """Return the rig with focal lengths multiplied by factors (C,)."""
    cameras = []
    for camera, factor in zip(rig.cameras, factors):
        matrix = camera.intrinsics.matrix @ np.diag([factor, factor, 1.0])
        cameras.append(replace(camera, intrinsics=replace(camera.intrinsics, matrix=matrix)))
    return replace(rig, cameras=tuple(cameras))


@pytest.mark.parametrize(
    ("factors", "text"),
    [
        ((1.06, 1.06, 1.06), "all cameras: people fit focal lengths [4-7].*% shorter"),
        ((1.0, 0.93, 1.0), "camera corner1: people fit focal lengths [5-9].*% longer"),
        ((1.0, 1.0, 1.0), None),
    ],
)
def test_wrong_focal_lengths_are_doubted_and_right_ones_are_not(factors, text):
    session = simulate_people(replace(SCENE, seconds=5.0), 1)
    found = calibrate_views(zoomed(session.rig, factors), session.views, SKELETON, untold)
    lines = [line for line in found.doubts if "focal" in line]
    assert len(lines) == (text is not None)
    assert text is None or re.search(text, lines[0])


def test_biases_of_the_detector_are_no_wrong_lens_and_gross_faults_are_refused():
    session = simulate_people(replace(SCENE, rig=Corners(4), bias_m=0.015), 0)
    found = calibrate_views(session.rig, session.views, SKELETON, untold)
    assert not any("focal" in line for line in found.doubts)
    with pytest.raises(CalibrationError, match="the given intrinsics are wrong: all cameras"):
        calibrate_views(zoomed(session.rig, [1.25] * 4), session.views, SKELETON, untold)
