"""Read rpt_msgs/Poses of RapidPoseTriangulation: the 2D poses that its detectors find in one camera."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from panoptic_ros.domain import JointMap, SkeletonModel, ViewDetections
from panoptic_ros.errors import DataError
from panoptic_ros.io.messages.family import stamp_of
from panoptic_ros.io.skeletons import map_joints

KIND = "rpt_msgs/msg/Poses"


def view_of_poses(
    message: Any, camera: str, image_size: tuple[int, int], number: int, skeleton: str
) -> ViewDetections:
    """Convert a message to the 2D poses of a camera.

    Args:
        message: `bodies_shape` is (people, joints, 3); `bodies_flat` holds x, y in px and a score for each
            joint.
        camera: name of the camera.
        image_size: (width, height) px of its images.
        number: number of the message, counted by the caller.
        skeleton: name of the working skeleton.

    Raises:
        DataError: on 3D poses or inconsistent lengths.
    """
    names = tuple(str(name) for name in message.joint_names)
    shape = tuple(int(n) for n in message.bodies_shape)
    flat = np.asarray(message.bodies_flat, np.float64)
    what = f"Poses of camera {camera}"
    if len(shape) == 3 and shape[2] == 4:
        raise DataError(f"{what} has 4 values per joint: these are 3D poses, expected 2D poses of a camera")
    if len(shape) != 3 or shape[1:] != (len(names), 3) or min(shape) < 0 or flat.size != np.prod(shape):
        raise DataError(
            f"{what}: bodies_shape {list(shape)} does not fit {len(names)} joint names and {flat.size} values"
        )
    model, joint_map, columns = _mapping(names, skeleton)
    bodies = flat.reshape(shape)[:, columns]
    scores = np.where(np.isfinite(bodies).all(axis=-1), np.clip(bodies[..., 2], 0.0, 1.0), 0.0)
    points, mapped = joint_map.apply(bodies[..., :2], scores)
    best = mapped.max(axis=1) if len(mapped) else np.zeros(0)
    return ViewDetections(
        camera, stamp_of(message.header), number, image_size, model.hash, points, mapped, best
    )


def skeleton_of_poses(names: Sequence[str], skeleton: str) -> SkeletonModel:
    """Return the working skeleton for joints with these names."""
    return _mapping(tuple(names), skeleton)[0]


@lru_cache(maxsize=16)
def _mapping(names: tuple[str, ...], skeleton: str) -> tuple[SkeletonModel, JointMap, list[int]]:
    """Return the skeleton, the joint map, and the columns that are used.

    Middle joints are means of others. They are skipped, because the skeleton derives them.
    """
    columns = [k for k, name in enumerate(names) if not name.endswith("_middle")]
    words = [re.sub(r"^(\w+)_(left|right)$", r"\2_\1", names[k]) for k in columns]
    model, joint_map = map_joints(skeleton, words)
    return model, joint_map, columns
