"""Score maps of a view as one picture."""

from __future__ import annotations

from typing import Any

import numpy as np

from panoptic_ros.domain import ViewDetections
from panoptic_ros.io.messages.family import Messages
from panoptic_ros.io.messages.images import optical_frame

Array = np.ndarray
WIDEST = 640  # px


def heat_map(view: ViewDetections, joint: int = -1) -> Array:
    """The largest score of all joints, or that of one joint, (h, w) uint8, 255 = 1, over the view's image.

    The picture has the proportions of the image and is at most `WIDEST` wide. 0 where the view has no maps.
    """
    import cv2  # 17 MB, which processes without images do without

    width, height = view.image_size
    columns = min(width, WIDEST)
    rows = max(1, round(height * columns / width))
    if view.maps is None:
        return np.zeros((rows, columns), np.uint8)
    grid = np.zeros(view.maps.grid_size[::-1], np.uint8)
    begin = 0
    for owner, (left, top), (wide, high) in zip(view.maps.joints, view.maps.corners, view.maps.sizes):
        patch = view.maps.data[begin : begin + wide * high].reshape(high, wide)
        begin += wide * high
        if joint in (-1, owner):
            place = grid[top : top + high, left : left + wide]
            np.maximum(place, patch, out=place)
    step = width / columns  # pixels of the image, whose first pixel's centre is (0, 0) as the picture's
    image_from_picture = np.array([[step, 0, (step - 1) / 2], [0, step, (step - 1) / 2], [0, 0, 1]])
    grid_from_picture = view.maps.grid_from_image @ image_from_picture
    how = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.asarray(cv2.warpAffine(grid, grid_from_picture, (columns, rows), flags=how))


def heat_map_message(view: ViewDetections, family: Messages, joint: int = -1) -> Any:
    """sensor_msgs/Image, mono8, of `heat_map`."""
    picture = heat_map(view, joint)
    rows, columns = picture.shape
    return family.make(
        "sensor_msgs/msg/Image",
        header=family.header(view.stamp_ns, optical_frame(view.camera)),
        height=rows,
        width=columns,
        encoding="mono8",
        is_bigendian=0,
        step=columns,
        data=family.sequence(np.ascontiguousarray(picture).reshape(-1)),
    )
