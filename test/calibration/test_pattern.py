"""Patterns: tracks, selection of points, rigs from them, their covariance and scale, refusals."""

import numpy as np
import pytest

from panoptic_ros.calibration.bundle import residuals_of
from panoptic_ros.calibration.pattern.solve import calibrate_pattern, with_distance
from panoptic_ros.calibration.pattern.tracks import FeatureMatches, PatternSightings, thinned, tracks_of
from panoptic_ros.calibration.people.frame import TAPE_SD_M
from panoptic_ros.calibration.projection import POSE
from panoptic_ros.calibration.rig_start import CameraInput
from panoptic_ros.calibration.world import rig_in_world
from panoptic_ros.errors import CalibrationError
from panoptic_ros.geometry import Rigid
from panoptic_ros.simulation.pattern_sessions import (
    VGA,
    VGA_FOCAL,
    CameraModel,
    PatternScene,
    simulate_pattern,
)
from panoptic_ros.stage import untold
from panoptic_ros.study.calibration.boards import CALIBRATED, poses_apart, uncertain_inputs

TWELVE = (CameraModel(12, VGA, VGA_FOCAL),)


def match(a, b, pairs, distance=0.0):
    first, second = np.array(pairs).T
    return FeatureMatches(a, b, first, second, np.full(len(first), distance))


def test_tracks_join_matches_of_pairs():
    counts = np.array([2, 3, 2])
    track, camera, feature = tracks_of(counts, [match(0, 1, [(0, 2)]), match(1, 2, [(2, 1), (0, 0)])])
    found = {tuple(zip(camera[track == t], feature[track == t])) for t in np.unique(track)}
    assert found == {((0, 0), (1, 2), (2, 1)), ((1, 0), (2, 0))}


def test_the_less_similar_match_that_gives_a_track_two_features_of_a_camera_is_left_out():
    matches = [match(0, 1, [(0, 0)]), match(1, 2, [(0, 0)]), match(0, 2, [(1, 0)], distance=5.0)]
    track, camera, feature = tracks_of(np.array([2, 1, 1]), matches)
    assert list(zip(track, camera, feature)) == [(0, 0, 0), (0, 1, 0), (0, 2, 0)]


def test_no_matches_are_no_tracks():
    assert all(len(part) == 0 for part in tracks_of(np.array([3, 2]), []))


def test_selected_points_have_many_views_and_leave_every_camera_some():
    session = simulate_pattern(PatternScene(TWELVE, points=800), 0)
    few = thinned(PatternSightings(session.cameras, session.points, session.pixels), 200)
    views = np.bincount(few.points)
    assert len(views) == 200 and views.min() >= 2 and (np.diff(few.points) >= 0).all()
    assert views.mean() > np.bincount(session.points).mean()
    assert np.bincount(few.cameras, minlength=12).min() >= 10


def solved(scene, seed, approximate=False, cameras=None):
    session, rng = simulate_pattern(scene, seed), np.random.default_rng(seed)
    inputs = uncertain_inputs(session.rig, CALIBRATED, rng)
    apart = np.linalg.norm(session.rig.cameras[0].centre - session.rig.cameras[5].centre)
    tape = (0, 5, apart + TAPE_SD_M * rng.standard_normal())
    sightings = PatternSightings(session.cameras, session.points, session.pixels)
    poses = [camera.cam_from_world for camera in session.rig.cameras] if approximate else None
    return calibrate_pattern(inputs, sightings, tape, untold, poses), session


def test_errors_of_blind_starts_are_as_large_as_stated():
    nees = []
    for seed in range(3):
        found, session = solved(PatternScene(TWELVE, scenes=2, points=500, outliers=0.02), seed)
        apart = poses_apart(rig_in_world(found, Rigid.identity()), session.rig)
        for c in range(1, 12):
            rows = found.index[c, :POSE]
            nees.append(apart[c] @ np.linalg.solve(found.covariance[np.ix_(rows, rows)], apart[c]) / POSE)
        assert found.outliers.sum() > 0.005 * len(session.pixels)
        np.testing.assert_allclose(found.noise, 0.3, atol=0.1)
    assert 0.4 < np.mean(nees) < 2.0


def test_given_poses_give_the_same_result():
    scene = PatternScene(TWELVE, points=600)
    (one, _), (other, _) = solved(scene, 3), solved(scene, 3, approximate=True)
    np.testing.assert_allclose(
        one.state.cameras.translations, other.state.cameras.translations, rtol=0.0, atol=2e-3
    )


def test_the_measured_distance_and_its_deviation_hold():
    found, _ = solved(PatternScene(TWELVE, points=600), 4)
    again = with_distance(found, 2, 7, 2.0)
    states = again.state.cameras
    centres = -np.einsum("cji,cj->ci", states.rotations, states.translations)
    assert np.linalg.norm(centres[7] - centres[2]) == pytest.approx(2.0)
    np.testing.assert_allclose(
        residuals_of(again.seen, again.state), residuals_of(found.seen, found.state), atol=1e-6
    )
    draws = np.random.default_rng(0).multivariate_normal(
        np.zeros(len(again.covariance)), again.covariance, 4000, check_valid="ignore"
    )
    distances = []
    for draw in draws:
        own = []
        for c in (2, 7):
            turn, move = draw[again.index[c, :3]], draw[again.index[c, 3:POSE]]
            shifted = states.translations[c] + move
            own.append(-states.rotations[c].T @ (shifted - np.cross(turn, shifted)))
        distances.append(np.linalg.norm(own[1] - own[0]))
    assert np.std(distances) == pytest.approx(TAPE_SD_M, rel=0.1)


def test_refusals_name_the_cameras():
    session = simulate_pattern(PatternScene(TWELVE, scenes=3, points=400), 0)
    inputs = uncertain_inputs(session.rig, CALIBRATED, np.random.default_rng(0))
    every = PatternSightings(session.cameras, session.points, session.pixels)

    def refusal(cameras, sightings):
        with pytest.raises(CalibrationError) as error:
            calibrate_pattern(cameras, sightings, (0, 1, 2.0), untold)
        return str(error.value)

    unknown = [CameraInput(own.name, own.size) if own.name == "cam4" else own for own in inputs]
    assert "camera cam4; give --intrinsics" in refusal(unknown, every)
    drop = every.cameras == 3
    drop[np.flatnonzero(drop)[:5]] = False
    few = PatternSightings(every.cameras[~drop], every.points[~drop], every.pixels[~drop])
    assert "camera cam3 (5): too few points" in refusal(inputs, few)
    pixels = every.pixels.copy()
    own = every.cameras == 3
    pixels[own] = np.random.default_rng(0).uniform(0.0, 480.0, (int(own.sum()), 2))
    assert "camera cam3" in refusal(inputs, every._replace(pixels=pixels))
