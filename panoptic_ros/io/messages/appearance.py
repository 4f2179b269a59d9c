"""Colours of clothes as sensor_msgs/PointCloud2: a point per 2D person of an image."""

from __future__ import annotations

from typing import Any

import numpy as np

from panoptic_ros.domain import ViewAppearance
from panoptic_ros.domain.appearance import CHANNELS, REGIONS
from panoptic_ros.errors import DataError
from panoptic_ros.io.messages.arrays import byte_array
from panoptic_ros.io.messages.family import Messages, stamp_of

FLOAT32, FLOAT64 = 7, 8  # of sensor_msgs/PointField
NUMBER = "frame_number"
COLOURS = tuple(f"{region}_{channel}" for region in REGIONS for channel in ("green", "red", "blue"))
NAMES = (NUMBER, *COLOURS)
OFFSETS = (0, *range(8, 8 + 4 * len(COLOURS), 4))
POINT = np.dtype([(NUMBER, "<f8"), *((name, "<f4") for name in COLOURS)])


def write_appearance(item: ViewAppearance, family: Messages, frame_id: str) -> Any:
    """The message of a view's colours."""
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
    """The record of a view's colours.

    Raises:
        DataError: if the message holds other points than these.
    """
    names = tuple(str(field.name) for field in message.fields)
    data, count = byte_array(message), int(message.width)
    if names != NAMES or message.is_bigendian or data.size != count * POINT.itemsize or not count:
        raise DataError(f"{count} points with {', '.join(names)} are no colours of clothes")
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
