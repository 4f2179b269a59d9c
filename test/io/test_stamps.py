"""Tables of stamps: this project's and caliscope's, by one reader."""

import pytest

from panoptic_ros.errors import DataError
from panoptic_ros.io.stamps import read_stamps, stamp_file, stamps_of_frames


def write(path, text):
    path.write_bytes(text.encode(errors="surrogateescape"))
    return path


def test_own_rows_may_come_in_any_order_with_other_columns(tmp_path):
    path = write(tmp_path / "a.csv", "note,stamp_ns,camera,frame\nx,7,b,0\n,5,a,1\n,3, a ,0\n\n")
    tables = read_stamps(path)
    assert stamps_of_frames(path, tables) == {"a": (3, 5), "b": (7,)}
    assert tables["a"].frames == [0, 1] and tables["a"].numbers is None


@pytest.mark.parametrize("camera", ["cam_id", "port"])
def test_seconds_of_caliscope_keep_all_their_digits(tmp_path, camera):
    rows = [f"{k},1,{1732681234 + k // 5}.{(k * 200_000_000) % 10**9:09d}" for k in (2, 0, 1)]
    rows = [f"sync_index,{camera},frame_time", *rows, "3,1,", "3,0,0.5"]
    path = write(tmp_path / "a.csv", "\n".join(rows))
    tables = read_stamps(path)
    begin = 1732681234 * 10**9
    assert tables["1"].stamps_ns == [begin, begin + 200_000_000, begin + 400_000_000]
    assert tables["0"].stamps_ns == [500_000_000] and tables["1"].numbers is None


def test_frames_that_a_device_counts_keep_their_numbers(tmp_path):
    path = write(tmp_path / "a.csv", "cam_id,frame_index,frame_time\n0,3,1.5\n0,0,1\n0,1,1.25\n1,0,1\n1,,2\n")
    tables = read_stamps(path)
    assert (tables["0"].numbers, tables["0"].stamps_ns) == ([0, 1, 3], [10**9, 1_250_000_000, 1_500_000_000])
    assert tables["1"].numbers is None and tables["1"].stamps_ns == [10**9, 2 * 10**9]
    with pytest.raises(DataError, match="camera 0: frame 2 has no stamp, though there are 3 rows"):
        stamps_of_frames(path, tables)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "line 1: columns camera, frame, stamp_ns expected, or cam_id and frame_time"),
        ("frame,camera\n", "line 1"),
        ("camera,frame,stamp_ns\na,0\n", "line 2"),
        ("camera,frame,stamp_ns\na,0,1.5\n", "line 2"),
        ("camera,frame,stamp_ns\na,0,-4\n", "out of range"),
        ("camera,frame,stamp_ns\na,0,1\na,0,2\n", "line 3: frame 0 of camera a a second time"),
        ("camera,frame,stamp_ns\na,0,1\na,2,2\n", "frame 1 has no stamp"),
        ("cam_id,frame_time\n0,now\n", "line 2: frame_time is 'now', expected a number"),
        ("cam_id,frame_time\n0,nan\n", "line 2"),
        ("cam_id,frame_time\n0,-1\n", "out of range"),
        ("cam_id,frame_time\n0,1e999999999\n", "out of range"),
        ("cam_id,frame_time\n,1\n", "line 2: cam_id is missing"),
        ("cam_id,frame_index,frame_time\n0,4,1\n0,4,2\n", "line 3: frame_index 4 of cam_id 0 a second time"),
        ("\udcff", "not text in UTF-8"),
    ],
)
def test_what_is_wrong_is_named(tmp_path, text, says):
    path = write(tmp_path / "timestamps.csv", text)
    with pytest.raises(DataError, match=says) as caught:
        stamps_of_frames(path, read_stamps(path))
    assert "timestamps.csv" in str(caught.value) and "\n" not in str(caught.value)


def test_the_table_of_a_folder_is_known_by_its_name(tmp_path):
    assert stamp_file(tmp_path) is None
    write(tmp_path / "imu_timestamps.csv", "")
    write(tmp_path / "frame_time_history.csv", "")
    assert stamp_file(tmp_path).name == "frame_time_history.csv"
    write(tmp_path / "timestamps.csv", "")
    assert stamp_file(tmp_path).name == "timestamps.csv"
