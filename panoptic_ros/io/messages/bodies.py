"""Bodies and samples of IMUs as messages, and back."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from panoptic_ros.domain.bodies import BodyStateSet, ImuSample, is_sound
from panoptic_ros.domain.checks import known_good
from panoptic_ros.errors import DataError
from panoptic_ros.io.messages.arrays import flat, joint_count, shaped
from panoptic_ros.io.messages.family import Messages, stamp_of, time_ns

Array = np.ndarray
_FIELDS = {  # of one body: shape, where a name stands for a size
    "offsets": ("S", 3),
    "freedoms": ("D",),
    "positions": ("S", 3),
    "orientations": ("S", 4),
    "velocities": ("S", 6),
    "covariances": ("S", 6, 6),
    "keypoints": ("J", 3),
    "keypoint_covariances": ("J", 3, 3),
}
UNKNOWN = -1.0  # first element of a covariance in sensor_msgs/Imu: not measured (REP 145)


def write_bodies(item: BodyStateSet, family: Messages, frame_id: str) -> Any:
    """panoptic_msgs/Bodies."""
    return family.make(
        "Bodies",
        header=family.header(item.stamp_ns, frame_id),
        newest_stamp=family.header(item.newest_ns, frame_id).stamp,
        index=item.index,
        skeleton_hash=item.skeleton_hash,
        joint_count=item.keypoints.shape[1],
        segment_names=list(item.segment_names),
        parents=flat(family, item.parents, np.int32),
        bodies=[
            family.make(
                "Body",
                id=int(item.ids[k]),
                source=int(item.sources[k]),
                views=int(item.views[k]),
                devices=int(item.devices[k]),
                **{name: flat(family, getattr(item, name)[k], np.float64) for name in _FIELDS},
            )
            for k in range(len(item.ids))
        ],
    )


def read_bodies(message: Any) -> BodyStateSet:
    """The record of a panoptic_msgs/Bodies.

    Raises:
        DataError: if its content is bad.
    """
    bodies, names = message.bodies, tuple(str(name) for name in message.segment_names)
    sizes = {"S": len(names), "D": 3 + 3 * len(names), "J": joint_count(message)}
    arrays = {}
    for name, letters in _FIELDS.items():
        shape = tuple(size if isinstance(size, int) else sizes[size] for size in letters)
        rows = [shaped(getattr(body, name), f"Body.{name}", *shape) for body in bodies]
        arrays[name] = np.array(rows, np.float64).reshape(len(bodies), *shape)
    return BodyStateSet(
        int(message.index),
        stamp_of(message.header),
        time_ns(message.newest_stamp),
        str(message.skeleton_hash),
        names,
        shaped(message.parents, "Bodies.parents", len(names)),
        np.array([body.id for body in bodies], np.int64),
        np.array([body.source for body in bodies], np.uint8),
        _counts("views", bodies),
        _counts("devices", bodies),
        **arrays,
    )


def _counts(name: str, bodies: Sequence[Any]) -> Array:
    """Whole numbers (B,) of a field of all bodies."""
    values = np.array([getattr(body, name) for body in bodies], np.int64)
    if (values > np.iinfo(np.int32).max).any():
        raise DataError(f"Body.{name} is {values.max()}, which is no number of {name}")
    return values.astype(np.int32)


def write_imu(item: ImuSample, family: Messages, frame_id: str) -> Any:
    """sensor_msgs/Imu, with the device as frame; what was not measured has -1 in its covariance."""

    def covariance(values: Array) -> Array:
        found = np.zeros(9)
        found[0] = UNKNOWN if np.isnan(values).any() else 0.0
        return found

    w, x, y, z = np.nan_to_num(item.orientation).tolist()
    rate, force = np.nan_to_num(item.rate).tolist(), np.nan_to_num(item.force).tolist()
    vector = "geometry_msgs/msg/Vector3"
    return family.make(
        "sensor_msgs/msg/Imu",
        header=family.header(item.stamp_ns, item.device),
        orientation=family.make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w),
        orientation_covariance=covariance(item.orientation),
        angular_velocity=family.make(vector, x=rate[0], y=rate[1], z=rate[2]),
        angular_velocity_covariance=covariance(item.rate),
        linear_acceleration=family.make(vector, x=force[0], y=force[1], z=force[2]),
        linear_acceleration_covariance=covariance(item.force),
    )


def read_imu(message: Any, device: str) -> ImuSample:
    """The sample of a sensor_msgs/Imu that came on the topic of a device.

    An orientation of zeros or NaN is not there: drivers of IMUs without one leave it so.

    Raises:
        DataError: if another number is not finite where the message says that it was measured.
    """
    turn, rate, force = message.orientation, message.angular_velocity, message.linear_acceleration
    return _sample(
        device,
        stamp_of(message.header),
        (
            ("orientation", (turn.w, turn.x, turn.y, turn.z), message.orientation_covariance[0]),
            ("angular_velocity", (rate.x, rate.y, rate.z), message.angular_velocity_covariance[0]),
            ("linear_acceleration", (force.x, force.y, force.z), message.linear_acceleration_covariance[0]),
        ),
    )


def imu_of_numbers(numbers: Sequence[float], stamp_ns: int, device: str) -> ImuSample:
    """The sample of a sensor_msgs/Imu whose numbers (37,) stand in the order of its definition.

    Raises:
        DataError: as `read_imu`.
    """
    x, y, z, w = numbers[:4]
    if UNKNOWN not in (numbers[4], numbers[16], numbers[28]):
        values = (w, x, y, z, *numbers[13:16], *numbers[25:28])
        if stamp_ns >= 0 and is_sound(values):  # as nearly always, thousands of times a second
            whole = np.array(values)
            whole.flags.writeable = False
            parts = {"orientation": whole[:4], "rate": whole[4:7], "force": whole[7:]}
            return known_good(ImuSample, {"device": device, "stamp_ns": stamp_ns, **parts})
    return _sample(
        device,
        stamp_ns,
        (
            ("orientation", (w, x, y, z), numbers[4]),
            ("angular_velocity", numbers[13:16], numbers[16]),
            ("linear_acceleration", numbers[25:28], numbers[28]),
        ),
    )


def _sample(device: str, stamp_ns: int, parts: Sequence[tuple[str, Sequence[float], float]]) -> ImuSample:
    """Of (field, numbers, first number of its covariance)."""
    found = []
    for name, values, covariance in parts:
        is_there = name != "orientation" or (any(values) and not any(map(math.isnan, values)))
        if covariance == UNKNOWN or not is_there:
            values = (np.nan,) * len(values)
        elif not all(map(math.isfinite, values)):
            raise DataError(
                f"Imu.{name} of {device} is {list(values)}; what is not measured has a covariance of -1"
            )
        array = np.array(values)
        array.flags.writeable = False
        found.append(array)
    return ImuSample(device, stamp_ns, found[0], found[1], found[2])
