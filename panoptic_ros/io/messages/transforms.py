"""Convert geometry_msgs/TransformStamped, the message of TF, to rigid transforms and back."""

from __future__ import annotations

from typing import Any

import numpy as np

from panoptic_ros.errors import DataError
from panoptic_ros.geometry import Rigid
from panoptic_ros.geometry.rotations import from_quaternions, to_quaternions
from panoptic_ros.io.messages.family import MessageFamily


def transform_message(
    family: MessageFamily, stamp_ns: int, parent: str, child: str, parent_from_child: Rigid
) -> Any:
    """Build a TransformStamped."""
    w, x, y, z = to_quaternions(parent_from_child.rotation).tolist()
    position = dict(zip("xyz", map(float, parent_from_child.translation)))
    return family.make(
        "geometry_msgs/msg/TransformStamped",
        header=family.header(stamp_ns, parent),
        child_frame_id=child,
        transform=family.make(
            "geometry_msgs/msg/Transform",
            translation=family.make("geometry_msgs/msg/Vector3", **position),
            rotation=family.make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w),
        ),
    )


def read_transform(message: Any) -> tuple[str, str, Rigid]:
    """Return (parent, child, parent_from_child); names have no leading slash, as in TF 2.

    Raises:
        DataError: on numbers that are not finite, a zero quaternion, or an empty name.
    """
    move, turn = message.transform.translation, message.transform.rotation
    numbers = np.array([move.x, move.y, move.z, turn.x, turn.y, turn.z, turn.w], float)
    parent, child = (str(name).lstrip("/") for name in (message.header.frame_id, message.child_frame_id))
    if not np.isfinite(numbers).all() or np.linalg.norm(numbers[3:]) < 1e-6 or not (parent and child):
        raise DataError(f"the transform from {child!r} to {parent!r} is none: {numbers.tolist()}")
    return parent, child, Rigid(from_quaternions(np.roll(numbers[3:], 1)), numbers[:3])
