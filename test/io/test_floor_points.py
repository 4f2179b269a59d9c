"""Points on the floor in CSV files, and what is wrong with them."""

import numpy as np
import pytest

from panoptic_ros.errors import DataError
from panoptic_ros.io.floor_points import read_floor_points
from test.support.board_images import small_rig

GOOD = "point,camera,x,y\ncorner,cam0,10,20.5\ncorner,cam2,30,40\ndoor,cam1,5,6\n"


def test_points_are_read_in_the_order_of_the_file(tmp_path):
    (tmp_path / "f.csv").write_text("\ufeff" + GOOD)
    names, pixels = read_floor_points(tmp_path / "f.csv", small_rig(3))
    assert names == ("corner", "door")
    np.testing.assert_array_equal(pixels[0], [[10, 20.5], [np.nan, np.nan], [30, 40]])
    np.testing.assert_array_equal(pixels[1], [[np.nan, np.nan], [5, 6], [np.nan, np.nan]])


@pytest.mark.parametrize(
    "text, message",
    [
        (GOOD.replace("point", "name"), "no column point"),
        (GOOD.replace("cam2", "cam9"), "unknown camera cam9; cameras are cam0, cam1, cam2"),
        (GOOD.replace("cam2", "cam0"), "point corner is marked twice in camera cam0"),
        (GOOD.replace("20.5", "left"), "f.csv"),
    ],
)
def test_wrong_files_are_named(tmp_path, text, message):
    (tmp_path / "f.csv").write_text(text)
    with pytest.raises(DataError, match=message):
        read_floor_points(tmp_path / "f.csv", small_rig(3))
