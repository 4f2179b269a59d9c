"""Which way is up, from people who stand and sit, and rigs that are turned by it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from panoptic_ros.domain import Camera, Occluders, Rig, SkeletonModel
from panoptic_ros.evaluation.rig_up import (
    check_up,
    direction_of,
    directions_of_people,
    turned_up,
    up_of,
    word_of,
)
from panoptic_ros.geometry import Intrinsics, Rigid

Array = np.ndarray
# x forward, y left, z up, m
STANDS = {
    "neck": (0.02, 0.0, 1.45),
    "nose": (0.12, 0.0, 1.6),
    "left_shoulder": (0.02, 0.18, 1.43),
    "right_shoulder": (0.02, -0.18, 1.43),
    "left_hip": (0.0, 0.1, 0.95),
    "right_hip": (0.0, -0.1, 0.95),
    "left_knee": (0.03, 0.1, 0.5),
    "right_knee": (0.0, -0.1, 0.5),
    "left_ankle": (0.0, 0.1, 0.08),
    "right_ankle": (0.0, -0.1, 0.08),
}
SITS = STANDS | {
    "left_knee": (0.45, 0.1, 0.95),
    "right_knee": (0.45, -0.1, 0.95),
    "left_ankle": (0.45, 0.1, 0.5),
    "right_ankle": (0.45, -0.1, 0.5),
    "neck": (0.1, 0.0, 1.44),
    "left_shoulder": (0.1, 0.18, 1.42),
    "right_shoulder": (0.1, -0.18, 1.42),
}
NAMES = tuple(STANDS)
SKELETON = SkeletonModel("stick", NAMES, 0, tuple((0, i) for i in range(1, len(NAMES))), 1)


def people(kinds: str, turn: Array, seed: int = 0) -> Array:
    """(M, J, 3) m of who stands (s), sits (c) or lies (l), facing anywhere, in a world turned by (3, 3)."""
    rng = np.random.default_rng(seed)
    found = []
    for kind in kinds:
        body = np.array([(SITS if kind == "c" else STANDS)[name] for name in NAMES])
        if kind == "l":
            body = body[:, [2, 1, 0]]
        yaw = Rotation.from_rotvec([0.0, 0.0, rng.uniform(0.0, 6.3)]).as_matrix()
        found.append((body + rng.normal(0.0, 0.02, body.shape)) @ yaw.T @ turn.T)
    return np.array(found)


def degrees_off(kinds: str, turn: Array, seed: int = 0) -> float:
    up = up_of(directions_of_people(people(kinds, turn, seed), SKELETON))
    assert up is not None
    return float(np.degrees(np.arccos(np.clip(up @ turn[:, 2], -1.0, 1.0))))


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("kinds", ["ssss", "sssccc", "cccccc", "ssssssll"])
def test_up_is_found_from_people_who_stand_or_sit(kinds: str, seed: int) -> None:
    turn = Rotation.random(random_state=seed).as_matrix()
    assert degrees_off(kinds, turn, seed) < (10.0 if "s" not in kinds else 3.0)


def test_lying_people_tell_nothing() -> None:
    assert up_of(directions_of_people(people("llllllll", np.eye(3)), SKELETON)) is None


def test_joints_that_are_missing() -> None:
    points = people("ssssss", np.eye(3))
    points[:, [NAMES.index("left_knee"), NAMES.index("left_ankle")]] = np.nan
    up = up_of(directions_of_people(points, SKELETON))
    assert up is not None and up[2] > np.cos(np.radians(5.0))


def level_rig() -> Rig:
    level = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    lens = Intrinsics(np.array([[800.0, 0, 320], [0, 800.0, 240], [0, 0, 1]]), np.zeros(5))
    places = ((-1.5, -3.0, 1.2), (0.0, -3.5, 1.0), (1.5, -3.0, 1.5))
    things = Occluders.box(np.array([1.0, 0.5, 0.7]), np.eye(3), np.array([0.0, 1.0, 0.35]))
    return Rig(
        tuple(
            Camera(f"c{i}", (640, 480), lens, Rigid(level, -level @ np.array(place)))
            for i, place in enumerate(places)
        ),
        occluders=things,
    )


@pytest.mark.parametrize("word", ["-y", "y", "x", "-x", "-z", "z", "0.3,-0.5,0.8"])
def test_the_rig_is_turned_by_the_command_that_the_notice_names(word: str) -> None:
    up = direction_of(word)
    assert up is not None and word_of(up) == (word if "," not in word else "0.303,-0.505,0.808")
    old_from_new = np.linalg.svd(np.eye(3) - np.outer(up, up))[0][:, :2]
    turn = np.column_stack([old_from_new, up])
    turn[:, 0] *= np.linalg.det(turn)  # a world in which `up` is up
    rig = level_rig()
    poses = [Rigid(c.cam_from_world.rotation @ turn.T, c.cam_from_world.translation) for c in rig.cameras]
    given = replace(
        rig,
        cameras=tuple(replace(c, cam_from_world=pose) for c, pose in zip(rig.cameras, poses)),
        occluders=replace(rig.occluders, vertices=rig.occluders.vertices @ turn.T) if rig.occluders else None,
    )
    (note,) = check_up(given, directions_of_people(people("ssss", turn), SKELETON)) or (None,)
    if up[2] > 0.72:
        assert note is None
    else:
        assert note is not None and f"`panoptic rig convert IN OUT --up={word_of(up)[:4]}" in note.text
    mended = turned_up(given, up)
    points = people("ss", np.eye(3))
    new_from_true = mended.cameras[0].cam_from_world.rotation.T @ rig.cameras[0].cam_from_world.rotation
    assert np.allclose(new_from_true[:, 2], [0.0, 0.0, 1.0], atol=1e-9)
    for old, new in zip(rig.cameras, mended.cameras):
        assert np.allclose(old.project(points)[0], new.project(points @ new_from_true.T)[0], atol=1e-6)
    assert rig.occluders is not None and mended.occluders is not None
    assert np.allclose(mended.occluders.vertices, rig.occluders.vertices @ new_from_true.T)


@pytest.mark.parametrize("word", ["", "up", "w", "--y", "1,2", "0,0,0", "nan,0,1", "1,2,3,4"])
def test_what_is_no_direction(word: str) -> None:
    assert direction_of(word) is None


def test_cameras_that_hang_upside_down_are_no_mistake() -> None:
    """Without people, a rig that states up may have turned cameras; one that does not has another up."""
    rig = level_rig()
    upside_down = np.diag([-1.0, -1.0, 1.0])
    hanging = replace(
        rig,
        cameras=tuple(
            replace(c, cam_from_world=Rigid(upside_down @ c.cam_from_world.rotation, [0.0, 0.0, 5.0]))
            for c in rig.cameras
        ),
    )
    nobody = np.zeros((0, 3))
    (note,) = check_up(hanging, nobody)
    assert note.severity == "info" and "upside down" in note.text and "--up=-z" in note.text
    (note,) = check_up(replace(hanging, up=None), nobody)
    assert note.severity == "warning" and "--up=-z" in note.text
    assert check_up(hanging, np.tile([0.0, 0.0, 1.0], (4, 1))) == []
