"""calibration.cal of Total Capture is converted as any other rig; what is wrong is told by its line."""

import numpy as np
import pytest

from panoptic_ros.cli.main import main
from panoptic_ros.errors import CalibrationError
from panoptic_ros.io.rigs import find_rig, read_rig

CAMERA = ["0 1079 0 1919", "1000 1001 960 540", "-0.1", "1 0 0", "0 -1 0", "0 0 -1", "0 1.5 4"]


def write(path, lines):
    (path / "calibration.cal").write_text("\n".join(lines) + "\n")
    return path / "calibration.cal"


def test_a_camera_in_front_of_the_origin_sees_what_is_above_it_above(tmp_path):
    path = write(tmp_path, ["1 1", *CAMERA])
    assert find_rig(tmp_path) == path
    (camera,) = read_rig(path).cameras
    assert camera.name == "cam1" and camera.image_size == (1920, 1080)
    np.testing.assert_allclose(camera.intrinsics.distortion, [-0.1, 0, 0, 0, 0])
    # 1.5 m up and 4 m along z in their world, where y is up: 4 m along x in ours, where z is
    np.testing.assert_allclose(camera.centre, [4.0, 0.0, 1.5])
    (middle, above), seen = camera.project(np.array([[0.0, 0.0, 1.5], [0.0, 0.0, 2.0]]))
    assert seen.all() and np.allclose(middle, [960.0, 540.0]) and above[1] < 500.0
    assert main(["rig", "convert", str(path), str(tmp_path / "rig.json")]) == 0
    assert read_rig(tmp_path / "rig.json").names == ("cam1",)


@pytest.mark.parametrize(
    "lines, told",
    [
        (["2 1", *CAMERA], "line 9: 0 numbers, expected 4: rows and columns of camera 2"),
        (["1 1", *CAMERA[:4], "0 1", *CAMERA[5:]], "line 6: 2 numbers, expected 3: rotation of camera 1"),
        (["1 2", *CAMERA], "line 4: 1 numbers, expected 2: terms of the lens of camera 1"),
        (["1 1", *CAMERA, "1 2 3"], "line 9: numbers behind the last of 1 cameras"),
        (["1 1", *CAMERA[:4], "5 0 0", *CAMERA[5:]], "camera cam1: "),
        (["0 1", *CAMERA], "line 1: 0 cameras"),
    ],
)
def test_what_is_wrong_is_told_by_its_line(tmp_path, lines, told):
    with pytest.raises(CalibrationError, match="calibration.cal") as found:
        read_rig(write(tmp_path, lines))
    assert told in str(found.value)
