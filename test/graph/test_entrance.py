"""Views that are not what their topic and the rig say are refused by name."""
from dataclasses import replace

import captures
import numpy as np
import pytest

from panoptic_ros.domain import ViewFrame
from panoptic_ros.errors import DataError
from panoptic_ros.graph.entrance import check_view

VIEW = captures.view(captures.RIG.cameras[0], 0, 0)


def check(view, camera="cam0"):
    check_view(view, camera, captures.RIG, captures.SKELETON)


def test_what_is_right_passes():
    check(VIEW)
    check(ViewFrame("cam0", 0, 0, np.zeros((720, 1280, 3), np.uint8)))


@pytest.mark.parametrize(
    ("view", "camera", "told"),
    [
        (VIEW, "cam1", "of camera 'cam0' came on a topic of cam1"),
        (replace(VIEW, image_size=(640, 360)), "cam0", "640 x 360, but it is calibrated for 1280 x 720"),
        (ViewFrame("cam0", 0, 0, np.zeros((36, 64, 3), np.uint8)), "cam0", "64 x 36"),
        (replace(VIEW, points=VIEW.points[:, :5], scores=VIEW.scores[:, :5]), "cam0", "5 joints"),
    ],
)
def test_what_is_not(view, camera, told):
    with pytest.raises(DataError, match=told):
        check(view, camera)
