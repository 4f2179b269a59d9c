"""Descriptions of boards by other programs."""

import pytest

from panoptic_ros.calibration.boards import Board
from panoptic_ros.errors import DataError
from panoptic_ros.io.board_files import read_board


def written(tmp_path, name, text):
    (tmp_path / name).write_text(text)
    return tmp_path / name


def test_targets_of_kalibr_are_read(tmp_path):
    grid = "target_type: 'aprilgrid'\ntagCols: 6\ntagRows: 5\ntagSize: 0.088\ntagSpacing: 0.3\n"
    found = read_board(written(tmp_path, "april.yaml", grid))
    assert found == Board("aprilgrid", 6, 5, 0.088, 0.3 * 0.088, "DICT_APRILTAG_36h11")
    plain = "target_type: checkerboard\ntargetCols: 6\ntargetRows: 7\n"
    plain += "rowSpacingMeters: 0.06\ncolSpacingMeters: 0.06\n"
    assert read_board(written(tmp_path, "checker.yaml", plain)) == Board("checkerboard", 6, 7, 0.06)


def test_boards_of_caliscope_are_read(tmp_path):
    text = 'columns = 4\nrows = 5\nboard_height = 11.0\nboard_width = 8.5\nunits = "inch"\n'
    text += 'dictionary = "DICT_4X4_1000"\naruco_scale = 0.75\ninverted = true\n'
    found = read_board(written(tmp_path, "charuco.toml", text))
    side = 8.5 / 4 * 0.0254
    assert found == Board("charuco", 4, 5, side, 0.75 * side, "DICT_4X4_1000")
    assert read_board(
        written(tmp_path, "c.toml", text + "square_size_override_cm = 5.4\n")
    ).size == pytest.approx(0.054)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        (
            "b.yaml",
            "target_type: circles\n",
            "target_type = 'circles'; boards are aprilgrid and checkerboard",
        ),
        ("b.yaml", "- 1\n", "describes no board"),
        ("b.yaml", "target_type: aprilgrid\ntagCols: 6\n", "tagRows = None; a positive number is expected"),
        (
            "b.yaml",
            "target_type: checkerboard\ntargetCols: 6\ntargetRows: 7\nrowSpacingMeters: 0.06\n"
            "colSpacingMeters: 0.05\n",
            "must be equal",
        ),
        ("b.toml", 'columns = 4\nrows = 5\nunits = "miles"\n', "units = 'miles'"),
        ("b.toml", "columns = 4\nrows = 5\nsquare_size_override_cm = 5.4\n", "unknown markers ''"),
    ],
)
def test_wrong_descriptions_are_named(tmp_path, name, text, message):
    with pytest.raises(DataError, match=message) as told:
        read_board(written(tmp_path, name, text))
    assert name in str(told.value)
