"""Build visualization_msgs/MarkerArray of 3D poses, for RViz and Foxglove."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from panoptic_ros.domain import JointState, SkeletonModel, TrackedPoseSet
from panoptic_ros.io.colors import rgb_of
from panoptic_ros.io.messages.family import MessageFamily

LINE_LIST, SPHERE_LIST, TEXT = 5, 7, 9
ADD, DELETE = 0, 2
PARTS = 3  # markers per person: bones, joints, text
LIFETIME_S = 0.5


def marker_array(
    poses: TrackedPoseSet, skeleton: SkeletonModel, frame_id: str, gone: Iterable[int], family: MessageFamily
) -> Any:
    """Build the markers of all people: bones, joints and id.

    Args:
        gone: ids of people whose markers are deleted.
    """
    markers = []
    header = family.header(poses.stamp_ns, frame_id)
    for k, person_id in enumerate(poses.ids.tolist()):
        markers += _person(poses, k, person_id, skeleton, header, family)
    for person_id in sorted(gone):
        markers += [
            _marker(family, header, person_id, part, LINE_LIST, [], 0.01, (1.0, 1.0, 1.0), action=DELETE)
            for part in range(PARTS)
        ]
    return family.make("visualization_msgs/msg/MarkerArray", markers=markers)


def _person(
    poses: TrackedPoseSet, k: int, person_id: int, skeleton: SkeletonModel, header: Any, family: MessageFamily
) -> list[Any]:
    there = poses.states[k] != JointState.MISSING
    positions = poses.positions[k]
    ends = [positions[j] for bone in skeleton.bones if there[list(bone)].all() for j in bone]
    colour = rgb_of(person_id)
    top = positions[there].max(axis=0) + [0.0, 0.0, 0.15] if there.any() else np.zeros(3)
    middle = np.append(positions[there].mean(axis=0)[:2], top[2]) if there.any() else top
    return [
        _marker(family, header, person_id, 0, LINE_LIST, ends, 0.025, colour),
        _marker(family, header, person_id, 1, SPHERE_LIST, list(positions[there]), 0.045, colour),
        _marker(family, header, person_id, 2, TEXT, [], 0.15, colour, text=str(person_id), at=middle),
    ]


def _marker(
    family: MessageFamily,
    header: Any,
    person_id: int,
    part: int,
    kind: int,
    points: list[Any],
    size: float,
    colour: tuple[float, float, float],
    *,
    text: str = "",
    at: Any = (0.0, 0.0, 0.0),
    action: int = ADD,
) -> Any:
    def point(xyz: Any) -> Any:
        x, y, z = (float(value) for value in xyz)
        return family.make("geometry_msgs/msg/Point", x=x, y=y, z=z)

    red, green, blue = colour
    nothing = family.sequence(np.zeros(0, np.uint8))
    seconds, rest = divmod(LIFETIME_S, 1.0)
    return family.make(
        "visualization_msgs/msg/Marker",
        header=header,
        ns="skeletons",
        id=person_id * PARTS + part,
        type=kind,
        action=action,
        pose=family.make(
            "geometry_msgs/msg/Pose",
            position=point(at),
            orientation=family.make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0),
        ),
        scale=family.make("geometry_msgs/msg/Vector3", x=size, y=size, z=size),
        color=family.make("std_msgs/msg/ColorRGBA", r=red, g=green, b=blue, a=1.0),
        lifetime=family.make("builtin_interfaces/msg/Duration", sec=int(seconds), nanosec=int(rest * 1e9)),
        frame_locked=False,
        points=[point(xyz) for xyz in points],
        colors=[],
        texture_resource="",
        texture=family.make("sensor_msgs/msg/CompressedImage", header=header, format="", data=nothing),
        uv_coordinates=[],
        text=text,
        mesh_resource="",
        mesh_file=family.make("visualization_msgs/msg/MeshFile", filename="", data=nothing),
        mesh_use_embedded_materials=False,
    )
