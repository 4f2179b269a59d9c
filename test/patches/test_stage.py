"""Motions of parts and patches against exact motion."""

from dataclasses import replace
from itertools import pairwise

import captures
import numpy as np
import patch_scene
import pytest

from panoptic_ros.domain import PatchTracks, PatchTrajectories
from panoptic_ros.errors import DataError
from panoptic_ros.graph.build import configure, make_stage

ANGLE, SHIFT = 0.05, np.array([0.02, -0.01, 0.005])


def stage(**values):
    return make_stage(
        "patches", configure({"patches": {"active": True, **values}})["patches"], captures.CONTEXT
    )


def run(items, **values):
    own, given = stage(**values), []
    notices = []
    for item in items:
        result = own.step(item)
        given += result.outputs
        notices += [notice.code for notice in result.notices]
    return given, notices


def moved_by(motions, row, points):
    """Points moved as a motion says."""
    c, s, vector = motions.centres[row], np.linalg.norm(motions.rotations[row]), motions.rotations[row]
    axis = vector / max(s, 1e-12)
    k = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    rotation = np.eye(3) + np.sin(s) * k + (1 - np.cos(s)) * k @ k
    return c + motions.translations[row] + (points - c) @ rotation.T


def test_a_rigid_motion_is_found_exactly_by_every_part():
    given, _ = run(patch_scene.recording(5))
    assert [len(item.motions.people) for item in given] == [0] + 4 * [len(patch_scene.PARTS)]
    positions = captures.people(0.0)[1]
    for item in given[1:]:
        after = patch_scene.turned(positions, ANGLE, SHIFT, positions.mean(axis=0))
        for row, part in enumerate(item.motions.parts.tolist()):
            joints = list(patch_scene.PARTS[part].joints)
            assert moved_by(item.motions, row, positions[joints]) == pytest.approx(after[joints], abs=3e-4)
        positions = after


def test_a_third_of_tracks_that_are_wrong_changes_little():
    given, _ = run(patch_scene.recording(4, wrong=0.3, noise_px=0.2))
    about = captures.people(0.0)[1].mean(axis=0)
    positions = captures.people(0.0)[1]
    after = patch_scene.turned(positions, ANGLE, SHIFT, about)
    errors = [
        np.linalg.norm(
            moved_by(given[1].motions, row, positions[list(patch_scene.PARTS[part].joints)])
            - after[list(patch_scene.PARTS[part].joints)],
            axis=1,
        ).max()
        for row, part in enumerate(given[1].motions.parts.tolist())
    ]
    assert np.median(errors) < 0.002 and max(errors) < 0.01


def test_covariances_hold_the_errors():
    squares = []
    for seed in range(3):
        items = patch_scene.recording(6, noise_px=0.5, start=20 * seed)
        positions = captures.people(0.0)[1]
        for item in run(items)[0][1:]:
            after = patch_scene.turned(positions, ANGLE, SHIFT, positions.mean(axis=0))
            for row in range(len(item.motions.parts)):
                centre = item.motions.centres[row][None]
                error = moved_by(item.motions, row, centre) - patch_scene.turned(
                    centre, ANGLE, SHIFT, positions.mean(axis=0)
                )
                own = item.motions.covariances[row, 3:, 3:]
                squares.append(float(error[0] @ np.linalg.solve(own, error[0])))
            positions = after
    assert np.mean(np.array(squares) < 7.81) >= 0.95  # of chi-squared with three degrees of freedom


def test_patches_move_with_the_body_and_keep_their_ids():
    given, _ = run(patch_scene.recording(6))
    about = captures.people(0.0)[1].mean(axis=0)
    for before, after in pairwise(given[1:]):
        about = about + SHIFT
        rows = {number: row for row, number in enumerate(before.ids.tolist())}
        both = [(rows[number], row) for row, number in enumerate(after.ids.tolist()) if number in rows]
        assert len(both) > 100
        first, last = (np.array(indices) for indices in zip(*both))
        expected = patch_scene.turned(before.positions[first], ANGLE, SHIFT, about)
        assert after.positions[last] == pytest.approx(expected, abs=2e-3)
        assert np.linalg.norm(after.normals, axis=1) == pytest.approx(1.0, abs=1e-5)
        assert (after.ages[last] == before.ages[first] + 1).all()


def test_normals_point_out_of_the_body_and_to_a_camera_that_sees_the_patch():
    item = run(patch_scene.recording(4))[0][-1]
    poses = [camera.cam_from_world for camera in captures.RIG.cameras]
    places = np.array([-pose.rotation.T @ pose.translation for pose in poses])
    towards = places - item.positions[:, None]
    towards /= np.linalg.norm(towards, axis=2, keepdims=True)
    cosines = np.einsum("nvi,ni->nv", towards, item.normals)
    assert (cosines[np.arange(len(item.ids)), item.visible.argmax(axis=1)] > -0.2).mean() > 0.95


def test_a_joint_that_no_view_measures_is_carried_on():
    """The forearm keeps its motion while its wrist is missing, until the time is over."""
    items, wrist = patch_scene.recording(14), captures.SKELETON.joint("lWrist")
    hidden = []
    for item in items:
        if not isinstance(item, PatchTracks) and item.index >= 4:
            item = patch_scene.skeletons(item.index, item.positions[0], missing=[wrist])
        hidden.append(item)
    given, _ = run(hidden, carry=0.2)
    forearm = next(k for k, part in enumerate(patch_scene.PARTS) if part.name == "lElbow-lWrist")
    there = [forearm in item.motions.parts.tolist() for item in given]
    assert there[1:9] == 8 * [True] and not any(there[10:])


def test_without_tracks_nothing_moves_and_that_is_said_once():
    people = [item for item in patch_scene.recording(40) if not isinstance(item, PatchTracks)]
    given, notices = run(people)
    assert all(not len(item.motions.people) and not len(item.ids) for item in given)
    assert notices == ["patches.no_tracks"]
    rest = patch_scene.recording(3, start=60)
    given, notices = run([*people, *rest])
    assert notices == ["patches.no_tracks", "patches.tracks_back"]
    assert len(given[-1].motions.people) == len(patch_scene.PARTS)


def test_no_more_patches_than_are_wanted():
    item = run(patch_scene.recording(5), per_part=3)[0][-1]
    for part in range(len(patch_scene.PARTS)):
        assert 0 < (item.parts == part).sum() <= 3 * (1 + (part == 0))
    assert isinstance(item, PatchTrajectories)


def test_tracks_of_another_rig_or_skeleton_are_refused():
    own = stage()
    track = patch_scene.recording(2)[1]
    for field, value, words in (("camera", "far", "not in the rig"), ("skeleton_hash", "00", "skeleton 00")):
        with pytest.raises(DataError, match=words):
            own.step(
                type(track)(**{**{name: getattr(track, name) for name in track.__slots__}, field: value})
            )


def test_tracks_that_agree_on_nothing_are_said_once_and_so_is_that_they_do_again():
    rng, items = np.random.default_rng(0), []
    for item in patch_scene.recording(45):
        if isinstance(item, PatchTracks) and item.frame_number <= 35:
            item = replace(item, ends=item.begins + rng.uniform(-40.0, 40.0, item.begins.shape))
        items.append(item)
    given, notices = run(items)
    assert notices == ["patches.no_motion", "patches.motion_back"]
    assert len(given[-1].motions.people) == len(patch_scene.PARTS)


@pytest.mark.parametrize("frozen", [False, True])
def test_a_camera_that_stops_or_freezes_changes_little(frozen):
    items = patch_scene.recording(8)
    cameras = sorted({item.camera for item in items if isinstance(item, PatchTracks)})
    kept = []
    for item in items:
        if isinstance(item, PatchTracks) and item.camera == cameras[0]:
            item = replace(item, ends=item.begins) if frozen else None
        kept += [] if item is None else [item]
    given, notices = run(kept)
    assert notices == [] and len(given[-1].motions.people) == len(patch_scene.PARTS)
    exact, _ = run(items)
    for one, other in zip(given[1:], exact[1:]):
        off = np.linalg.norm(one.motions.translations - other.motions.translations, axis=1)
        assert np.median(off) < 0.002
