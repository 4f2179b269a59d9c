"""Heat maps are where the scores are in the image."""

import captures
import numpy as np

from panoptic_ros.domain import ScoreMaps, ViewDetections
from panoptic_ros.io.messages import bag_messages
from panoptic_ros.io.messages.images import heat_map, heat_map_message


def view(maps):
    joints = len(captures.SKELETON)
    return ViewDetections(
        "cam0",
        7,
        0,
        (1280, 720),
        captures.SKELETON.hash,
        np.full((1, joints, 2), np.nan),
        np.zeros((1, joints)),
        np.ones(1),
        maps,
    )


def test_a_patch_lies_where_its_cells_are_in_the_image():
    patch = np.zeros((3, 5), np.uint8)
    patch[1, 2] = 200  # the cell (42, 21), the centre of 8 x 8 pixels
    maps = ScoreMaps(
        (160, 90),
        np.array([[1 / 8, 0, 0.5 / 8 - 0.5], [0, 1 / 8, 0.5 / 8 - 0.5]]),
        np.array([3, 4]),
        np.array([0, 0]),
        np.array([[40, 20], [0, 0]]),
        np.array([[5, 3], [1, 1]]),
        np.concatenate([patch.ravel(), np.array([90], np.uint8)]),
    )
    picture = heat_map(view(maps), 3)
    assert picture.shape == (360, 640)
    rows, columns = np.nonzero(picture >= picture.max() - 10)
    assert abs(columns.mean() - (42 * 4 + 1.5)) < 0.6 and abs(rows.mean() - (21 * 4 + 1.5)) < 0.6
    assert picture[:4, :4].max() == 0 and 60 <= heat_map(view(maps))[:4, :4].max() <= 90


def test_a_view_without_maps_is_black():
    message = heat_map_message(view(None), bag_messages())
    assert (message.width, message.height, message.encoding) == (640, 360, "mono8")
    assert message.header.frame_id == "cam0_optical_frame" and not np.any(message.data)
