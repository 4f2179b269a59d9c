"""Convert records to sensor_msgs and back: IMU samples as Imu, clothing colours as PointCloud2."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from panoptic_ros.domain import ViewAppearance
from panoptic_ros.domain.appearance import CHANNELS, REGIONS
from panoptic_ros.domain.bodies import ImuSample, is_sound
from panoptic_ros.domain.checks import known_good
from panoptic_ros.errors import DataError
from panoptic_ros.io.messages.encodings import byte_array
from panoptic_ros.io.messages.family import MessageFamily, stamp_of

Array = np.ndarray
UNKNOWN = -1.0  # first element of a covariance in sensor_msgs/Imu: not measured (REP 145)
FLOAT32, FLOAT64 = 7, 8  # datatypes of sensor_msgs/PointField
NUMBER = "frame_number"
COLOURS = tuple(f"{region}_{channel}" for region in REGIONS for channel in ("green", "red", "blue"))
NAMES = (NUMBER, *COLOURS)
OFFSETS = (0, *range(8, 8 + 4 * len(COLOURS), 4))
POINT = np.dtype([(NUMBER, "<f8"), *((name, "<f4") for name in COLOURS)])


def write_appearance(item: ViewAppearance, family: MessageFamily, frame_id: str) -> Any:
    """Build a sensor_msgs/PointCloud2 of the clothing colours in a view."""
    points = np.empty(len(item.colours), POINT)
    points[NUMBER] = item.frame_number
    for name, values in zip(COLOURS, item.colours.reshape(-1, len(COLOURS)).T):
        points[name] = values
    fields = [
        family.make(
            "sensor_msgs/msg/PointField",
            name=name,
            offset=offset,
            datatype=FLOAT64 if name == NUMBER else FLOAT32,
            count=1,
        )
        for name, offset in zip(NAMES, OFFSETS)
    ]
    return family.make(
        "sensor_msgs/msg/PointCloud2",
        header=family.header(item.stamp_ns, item.camera),
        height=1,
        width=len(points),
        fields=fields,
        is_bigendian=False,
        point_step=POINT.itemsize,
        row_step=POINT.itemsize * len(points),
        data=family.sequence(points.view(np.uint8).reshape(-1)),
        is_dense=False,
    )


def read_appearance(message: Any) -> ViewAppearance:
    """Read the clothing colours of a view.

    Raises:
        DataError: if the message has other point fields, or an invalid length or frame number.
    """
    names = tuple(str(field.name) for field in message.fields)
    data, count = byte_array(message), int(message.width)
    if names != NAMES or message.is_bigendian or data.size != count * POINT.itemsize or not count:
        raise DataError(f"{count} points with {', '.join(names)} are not colours of clothes")
    points = np.frombuffer(data.tobytes(), POINT)
    colours = np.stack([points[name] for name in COLOURS], axis=1)
    number = points[NUMBER][0]
    if not 0.0 <= number < 2**53:
        raise DataError(f"colours of clothes of image {number}; images count from 0")
    return ViewAppearance(
        str(message.header.frame_id),
        stamp_of(message.header),
        int(number),
        colours.reshape(count, len(REGIONS), CHANNELS),
    )


def write_imu(item: ImuSample, family: MessageFamily, frame_id: str) -> Any:
    """Build a sensor_msgs/Imu with the device as frame; the covariance of missing values begins with -1."""

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
    """Convert a sensor_msgs/Imu from a device's topic to a sample.

    An orientation of zeros or NaN is treated as missing: IMU drivers without orientation publish it so.

    Raises:
        DataError: if a measured value is not finite.
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
    """Convert the numbers (37,) of a sensor_msgs/Imu, in the order of its definition, to a sample.

    Raises:
        DataError: as `read_imu`.
    """
    x, y, z, w = numbers[:4]
    if UNKNOWN not in (numbers[4], numbers[16], numbers[28]):
        values = (w, x, y, z, *numbers[13:16], *numbers[25:28])
        if stamp_ns >= 0 and is_sound(values):  # fast path for nearly all samples, thousands per second
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
    """Build a sample from (field, values, first element of the covariance) of each quantity.

    Raises:
        DataError: if a measured value is not finite.
    """
    found = []
    for name, values, covariance in parts:
        is_there = name != "orientation" or (any(values) and not any(map(math.isnan, values)))
        if covariance == UNKNOWN or not is_there:
            values = (np.nan,) * len(values)
        elif not all(map(math.isfinite, values)):
            raise DataError(
                f"Imu.{name} of {device} is {list(values)}; a quantity that is not measured must have a "
                "covariance of -1"
            )
        array = np.array(values)
        array.flags.writeable = False
        found.append(array)
    return ImuSample(device, stamp_ns, found[0], found[1], found[2])
