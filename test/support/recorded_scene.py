"""A bag of people who stand still, with images, as `panoptic run` leaves one; all numbers are known."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from panoptic_ros.domain import (
    Camera,
    JointState,
    PartMotions,
    PatchTrajectories,
    Preview,
    RefinedPoseSet,
    Rig,
    SkeletonModel,
    ViewDetections,
    ViewSources,
)
from panoptic_ros.geometry import Intrinsics, Rigid
from panoptic_ros.graph.topics import TOPICS
from panoptic_ros.io.bags import BagWriter
from panoptic_ros.io.messages import bag_messages, to_message
from panoptic_ros.io.messages.family import bag_typestore

START_NS = 1_700_000_000_000_000_000
SKELETON = SkeletonModel(
    "stick",
    ("hip", "head", "left_knee", "left_ankle", "right_knee", "right_ankle"),
    0,
    ((0, 1), (0, 2), (2, 3), (0, 4), (4, 5)),
    1,
)
BODY = np.array([[0, 0, 1], [0, 0, 1.7], [0.2, 0, 0.5], [0.2, 0, 0.1], [-0.2, 0, 0.5], [-0.2, 0, 0.1]])
SIZE = 640, 480
GREY = 90  # of every image


def make_rig(count: int = 4) -> Rig:
    """Cameras on a ring, with bent lenses, the last one a fisheye."""
    cameras = []
    for i in range(count):
        angle = 2 * np.pi * i / count
        forward = np.array([-np.cos(angle), -np.sin(angle), 0.0])
        rotation = np.array([[-np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, -1.0], forward])
        centre = np.array([4 * np.cos(angle), 4 * np.sin(angle), 1.1])
        matrix = [[420.0, 0.0, 322.0], [0.0, 425.0, 238.0], [0.0, 0.0, 1.0]]
        lens = (
            Intrinsics(matrix, [0.05, -0.01, 0.0, 0.0], "fisheye")
            if i == count - 1
            else Intrinsics(matrix, [-0.25, 0.06, 0.002, -0.001, 0.0])
        )
        cameras.append(Camera(f"cam{i}", SIZE, lens, Rigid(rotation, -rotation @ centre)))
    return Rig(tuple(cameras))


def places(index: int) -> dict[int, tuple[float, float]]:
    """Who stands where at an instant: id 7 comes after a second, id 2 leaves before the last."""
    there = {2: (-0.7, 0.1), 7: (0.8, -0.3)}
    return {who: at for who, at in there.items() if (who == 2 and index < 90) or (who == 7 and index >= 30)}


def make_poses(rig: Rig, index: int, stamp_ns: int) -> RefinedPoseSet:
    """The people of an instant; joint 5 of everybody is predicted."""
    who = places(index)
    positions = np.array([BODY + [x, y, 0.0] for x, y in who.values()]).reshape(-1, 6, 3)
    states = np.full(positions.shape[:2], JointState.MEASURED)
    states[:, 5] = JointState.PREDICTED
    spread = np.broadcast_to(np.diag([1e-4, 4e-4, 9e-4]), (*positions.shape, 3))
    sources = ViewSources(
        rig.names,
        np.full(len(rig), 1000 + index, np.uint64),
        np.tile(np.arange(len(who), dtype=np.int32)[:, None], (1, len(rig))),
    )
    return RefinedPoseSet(
        index,
        stamp_ns,
        SKELETON.hash,
        positions,
        spread,
        np.full(positions.shape[:2], 0.9),
        np.full(positions.shape[:2], len(rig)),
        states,
        np.full(len(who), 0.9),
        sources=sources,
        ids=list(who),
    )


def make_view(camera: Camera, poses: RefinedPoseSet, stamp_ns: int, shift=(3.0, -4.0)) -> ViewDetections:
    """What a camera sees of them, 5 px off."""
    points = camera.project(poses.positions)[0] + shift
    return ViewDetections(
        camera.name,
        stamp_ns,
        1000 + poses.index,
        camera.image_size,
        SKELETON.hash,
        points,
        0.8 * np.isfinite(points).all(-1),
        np.full(len(points), 0.8),
    )


def make_patches(rig: Rig, index: int, stamp_ns: int) -> PatchTrajectories:
    """One patch per joint of everybody, of a part of that number, 30 cm in front of it; the last camera sees
    none."""
    who = places(index)
    joints, count = len(BODY), len(BODY) * len(who)
    positions = np.array([BODY + [x, y - 0.3, 0.0] for x, y in who.values()]).reshape(-1, 3)
    seen = np.ones((count, len(rig)))
    seen[:, -1] = 0.1
    return PatchTrajectories(
        index,
        stamp_ns,
        stamp_ns,
        SKELETON.hash,
        np.arange(count),
        np.zeros(count),
        np.repeat(list(who), joints),
        np.tile(np.arange(joints), len(who)),
        positions,
        np.tile([0.0, -1.0, 0.0], (count, 1)),
        np.full(count, 0.001),
        rig.names,
        seen,
        PartMotions(
            np.zeros(0), np.zeros(0), *np.zeros((3, 0, 3)), np.zeros((0, 6, 6)), np.zeros(0), np.zeros(0)
        ),
        np.zeros((0, 2)),
    )


def make_preview(camera: str, stamp_ns: int) -> Preview:
    """An even grey image."""
    _, data = cv2.imencode(".jpg", np.full((240, 320, 3), GREY, np.uint8))
    return Preview(camera, stamp_ns, data.tobytes())


def as_bytes(record: object, little: bool = True) -> bytes:
    """CDR bytes of a record's message."""
    message = to_message(record, bag_messages())
    return bytes(bag_typestore().serialize_cdr(message, message.__msgtype__, little_endian=little))


def write_scene(
    path: Path, instants: int = 120, rate: float = 30.0, previews: bool = True, patches: bool = False
) -> Rig:
    """Write the bag; every third image has a preview. Stamps of cameras are 2 ms before those of instants."""
    rig, family = make_rig(), bag_messages()
    with BagWriter(path) as bag:

        def write(key: str, record: object, stamp_ns: int, owner: str = "") -> None:
            bag.write("/" + TOPICS[key].of(owner), stamp_ns, to_message(record, family))

        write("rig", rig, START_NS)
        write("skeleton_model", SKELETON, START_NS)
        for index in range(instants):
            stamp = START_NS + round(index * 1e9 / rate)
            poses = make_poses(rig, index, stamp)
            for camera in rig.cameras:
                write("detections", make_view(camera, poses, stamp - 2_000_000), stamp, camera.name)
                if previews and index % 3 == 0:
                    write("preview", make_preview(camera.name, stamp - 2_000_000), stamp, camera.name)
            if patches:
                write("patches", make_patches(rig, index, stamp), stamp)
            write("skeletons", poses, stamp)
    return rig
