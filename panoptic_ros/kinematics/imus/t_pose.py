"""Mountings of IMUs from a T-pose, and their heading without cameras, from how joints bend.

A wrong heading in a T-pose enters the mountings. Segments then rotate about wrong axes: knees, for example,
seem to bend sideways. Rotations between neighbouring segments since the T-pose, rotated by the heading,
should be rotations that human joints make. The estimated heading makes them most likely under the pose prior.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from panoptic_ros.domain.segments import SegmentModel
from panoptic_ros.domain.subjects import Subject, TPose
from panoptic_ros.errors import DataError
from panoptic_ros.geometry.rotations import mean_rotation, turn_about_z, vectors_of
from panoptic_ros.kinematics.imus.measured import ImuMeasurements
from panoptic_ros.kinematics.pose.prior import PoseStatistics

Array = np.ndarray

MOST_INSTANTS = 600
FEWEST_INSTANTS = 60
LEAST_TURN = math.radians(20.0)  # minimum root mean square rotation of at least one joint
SCALE2 = 9.0  # scale of Cauchy's loss, of squared distances in standard deviations
STEPS = 360  # number of headings that are tried
ERROR = math.radians(5.0)  # error per axis of a segment in the T-pose


def heading_from_poses(
    subject: Subject,
    statistics: PoseStatistics,
    turns: Mapping[str, Array],
    held: Mapping[str, Sequence[Array] | Array],
) -> float | None:
    """Return the heading, rad, world from the IMUs' inertial frame, or None.

    It is None with little motion or too few devices. The subject is taken to face in the T-pose as stated.

    Args:
        turns: Orientations (N, 3, 3) of each device at the same instants, NaN = missing.
        held: Orientations (M, 3, 3) of each device in the T-pose.
    """
    model = subject.body.model
    moved: dict[int, Array] = {}
    for device in subject.devices:
        if device.name in turns and device.name in held:
            every = max(len(turns[device.name]) // MOST_INSTANTS, 1)
            moved[device.segment] = turns[device.name][::every] @ mean_rotation(np.array(held[device.name])).T
    joints = _joints(moved, model)
    found, typical = [], []
    for segment, above in joints.items():
        local = moved[above].swapaxes(1, 2) @ moved[segment]
        local = local[np.isfinite(local).all((1, 2))]
        if len(local) >= FEWEST_INSTANTS:
            found.append(vectors_of(np.ascontiguousarray(local)))
            typical.append(_statistics(statistics, model, segment, above))
    far = [math.sqrt(float((vectors[:, :2] ** 2).sum(1).mean())) for vectors in found]
    if max(far, default=0.0) < LEAST_TURN:
        return None
    angles = 2.0 * math.pi * np.arange(STEPS) / STEPS
    costs = np.array([_cost(angle, found, typical) for angle in angles])
    pose = subject.t_pose
    facing = np.array([1.0, 0.0, 0.0]) if pose is None or pose.facing is None else pose.facing
    heading = float(angles[int(costs.argmin())]) + math.atan2(facing[1], facing[0])
    return math.remainder(heading, 2.0 * math.pi)


def t_pose_decides(subject: Subject) -> bool:
    """Return whether a T-pose determines the mounting of any device of the subject.

    The heading then matters for the mountings.
    """
    return subject.t_pose is not None and any(device.mount is None for device in subject.devices)


def bent_line(heading: float) -> str:
    """Return the line for the user about a heading from bending joints."""
    found = f"{math.degrees(heading):.0f} deg, as its joints bend"
    return f"no camera shows the heading of its IMUs, which is assumed to be {found}"


def _joints(moved: Mapping[int, Array], model: SegmentModel) -> dict[int, int]:
    """Return the segments with a device, each with its nearest ancestor that has one too."""
    found = {}
    for segment in moved:
        above = int(model.parents[segment])
        while above >= 0 and above not in moved:
            above = int(model.parents[above])
        if above >= 0:
            found[segment] = above
    return found


def _statistics(
    statistics: PoseStatistics, model: SegmentModel, segment: int, above: int
) -> tuple[Array, Array]:
    """Return mean (3,) rad and information (3, 3) of the rotation of a segment relative to an ancestor."""
    mean, covariance = np.zeros(3), 2.0 * ERROR**2 * np.eye(3)
    k = segment
    while k != above:
        rows = slice(3 * k - 3, 3 * k)
        part = statistics.components[rows] * statistics.deviations
        mean += statistics.mean[rows]
        covariance += part @ part.T + np.diag(statistics.spreads[rows] ** 2)
        k = int(model.parents[k])
    return mean, np.linalg.inv(covariance)


def _cost(angle: float, found: list[Array], typical: list[tuple[Array, Array]]) -> float:
    turn, total = turn_about_z(angle), 0.0
    for vectors, (mean, information) in zip(found, typical):
        apart = vectors @ turn.T - mean
        square = ((apart @ information) * apart).sum(1)
        total += float(np.log1p(square / SCALE2).mean())
    return total


def held_in(pose: TPose, stamps: Array, felt: ImuMeasurements) -> Array:
    """Return the orientations (M, 3, 3) of a device during a T-pose.

    Args:
        stamps: (T,) ns, timestamps of the measurements.
        felt: Measurements of the device, one row per timestamp.
    """
    found: Array = felt.orientations[(pose.from_ns <= stamps) & (stamps <= pose.to_ns) & felt.oriented]
    return found


def t_pose_mounts(
    subject: Subject, stamps: Array, felt: Mapping[str, ImuMeasurements], heading: float
) -> tuple[dict[str, Array], list[str]]:
    """Return the mounting (3, 3) of every worn device, and lines about devices without one.

    A mounting is segment from device. It is as stated, or else from the T-pose. A device without samples in
    the T-pose gets a line instead.

    Args:
        stamps: (T,) ns.
        felt: Measurements at these timestamps, by device name.
        heading: rad, world from the IMUs' inertial frame.

    Raises:
        DataError: If a device has neither a stated mounting nor a T-pose.
    """
    mounts, lines = {}, []
    for device in subject.devices:
        if device.name not in felt:
            continue
        if device.mount is not None:
            mounts[device.name] = device.mount
            continue
        pose = subject.t_pose
        if pose is None:
            raise DataError(
                f"subject {subject.id}: device {device.name} has no mount, and there is no t_pose to find "
                "it from; state one of them"
            )
        held = held_in(pose, stamps, felt[device.name])
        if len(held):
            mounts[device.name] = t_pose_mount(pose, heading, held)
        else:
            text = f"device {device.name} has no samples in the T-pose; it is left out"
            lines.append(f"subject {subject.id}: {text}")
    return mounts, lines


def t_pose_mount(pose: TPose, heading: float, held: Sequence[Array] | Array) -> Array:
    """Return the mounting (3, 3), segment from device, of a device from a T-pose.

    Args:
        heading: rad, world from the IMUs' inertial frame.
        held: Orientations (3, 3) of the device in the T-pose.
    """
    facing = pose.facing if pose.facing is not None else np.array([1.0, 0.0, 0.0])
    body = turn_about_z(float(np.arctan2(facing[1], facing[0])))
    found: Array = body.T @ turn_about_z(heading) @ mean_rotation(np.array(held))
    return found
