"""How IMUs are mounted, from a T-pose."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from panoptic_ros.domain.subjects import Instant, Subject, TPose
from panoptic_ros.errors import DataError
from panoptic_ros.geometry.rotations import mean_rotation, turn_about_z

Array = np.ndarray


def t_pose_mounts(
    subject: Subject, instants: Sequence[Instant], worn: set[str], heading: float
) -> tuple[dict[str, Array], list[str]]:
    """Mounting (3, 3), segment from device, of every device worn, as stated or as the T-pose tells it; and a
    line for each that has no samples in it.

    Args:
        heading: rad, world from the IMUs' inertial frame.

    Raises:
        DataError: if neither is there.
    """
    mounts, lines = {}, []
    for device in subject.devices:
        if device.name not in worn:
            continue
        if device.mount is not None:
            mounts[device.name] = device.mount
            continue
        pose = subject.t_pose
        if pose is None:
            raise DataError(
                f"subject {subject.id}: device {device.name} has no mount, and there is no t_pose to "
                "tell it; state one of them"
            )
        held = [
            instant.readings[device.name].orientation
            for instant in instants
            if pose.from_ns <= instant.stamp_ns <= pose.to_ns and device.name in instant.readings
        ]
        held = [r for r in held if np.isfinite(r).all()]
        if held:
            mounts[device.name] = t_pose_mount(pose, heading, held)
        else:
            text = f"device {device.name} has no samples in the T-pose; it is left out"
            lines.append(f"subject {subject.id}: {text}")
    return mounts, lines


def t_pose_mount(pose: TPose, heading: float, held: Sequence[Array]) -> Array:
    """Mounting (3, 3), segment from device, of a device with these orientations (3, 3) in a T-pose.

    Args:
        heading: rad, world from the IMUs' inertial frame.
    """
    facing = pose.facing if pose.facing is not None else np.array([1.0, 0.0, 0.0])
    body = turn_about_z(float(np.arctan2(facing[1], facing[0])))
    found: Array = body.T @ turn_about_z(heading) @ mean_rotation(np.array(held))
    return found
