"""Bodies as other packages know them: sensor_msgs/JointState of REP 155, TF of segments."""

from __future__ import annotations

from typing import Any

import numpy as np

from panoptic_ros.domain import BodyStateSet
from panoptic_ros.domain.body_names import joint_names, link_names
from panoptic_ros.domain.segments import SegmentModel
from panoptic_ros.geometry import Rigid
from panoptic_ros.geometry.rotations import from_quaternions
from panoptic_ros.io.messages.family import Messages
from panoptic_ros.io.messages.people import body_name
from panoptic_ros.io.messages.transforms import transform_message


def joint_state_message(item: BodyStateSet, k: int, model: SegmentModel, family: Messages) -> Any:
    """sensor_msgs/JointState of the k-th body: angles, rad."""
    angles = model.joint_angles(from_quaternions(item.orientations[k]))
    body = body_name(int(item.ids[k]))
    nothing = family.sequence(np.zeros(0))
    return family.make(
        "sensor_msgs/msg/JointState",
        header=family.header(item.stamp_ns, f"body_{body}"),
        name=joint_names(model, body),
        position=family.sequence(np.ascontiguousarray(angles)),
        velocity=nothing,
        effort=nothing,
    )


def segment_transforms(
    item: BodyStateSet, model: SegmentModel, frame_id: str, prefix: str, family: Messages
) -> list[Any]:
    """A TransformStamped of every segment of every body in its parent's frame, of the root in the world."""
    found = []
    for k, number in enumerate(item.ids.tolist()):
        frames, places = from_quaternions(item.orientations[k]), item.positions[k]
        names = [prefix + name for name in link_names(model, body_name(number))]
        for s, above in enumerate(model.parents.tolist()):
            pose = Rigid(frames[s], places[s])
            if s:
                pose = Rigid(frames[above].T @ frames[s], frames[above].T @ (places[s] - places[above]))
            parent = names[above] if s else frame_id
            found.append(transform_message(family, item.stamp_ns, parent, names[s], pose))
    return found
