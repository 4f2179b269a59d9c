"""When recordings begin: timecode tracks, late starts, numbers of images."""

from fractions import Fraction

import cv2
import numpy as np
import pytest

from panoptic_ros.capture.folder import open_capture_folder, open_files
from panoptic_ros.capture.image_folder import ImageFolderSource, image_numbers
from panoptic_ros.capture.starts import read_label
from panoptic_ros.capture.video import VideoSource
from panoptic_ros.domain import Camera, Rig
from panoptic_ros.errors import DataError
from panoptic_ros.geometry import Intrinsics, Rigid

SIZE = (64, 48)
FRAME = 3600  # ticks of 1/90000 s, at 25 Hz
MS = 10**6


def rig(*names):
    lens = Intrinsics([[50.0, 0.0, 30.0], [0.0, 55.0, 25.0], [0.0, 0.0, 1.0]], [])
    return Rig(tuple(Camera(name, SIZE, lens, Rigid.identity()) for name in names))


def times(count=20, late=0, period=FRAME):
    return [period * k + late for k in range(count)]


def images(folder, numbers, name="{:04d}.png"):
    folder.mkdir(parents=True)
    for number in numbers:
        cv2.imwrite(str(folder / name.format(number)), np.full((48, 64, 3), number % 250, np.uint8))


def stamps_of(capture):
    return {source.camera: [frame.stamp_ns for frame in source] for source in capture.sources}


@pytest.mark.parametrize(
    ("text", "rate", "counted", "seconds"),
    [
        ("10:00:00:05", 25, None, 36000 + Fraction(5, 25)),
        ("00:00:01:00", Fraction(30000, 1001), None, Fraction(1001, 1000)),
        ("00:01:00;02", Fraction(30000, 1001), None, Fraction(1800 * 1001, 30000)),  # after :59;29
        ("00:10:00;00", Fraction(30000, 1001), None, Fraction(17982 * 1001, 30000)),
        ("00:01:00;04", Fraction(60000, 1001), None, Fraction(3600 * 1001, 60000)),
        ("00:00:00:12", 50, (25, Fraction(25)), Fraction(12, 25)),
        ("00:00:00:30", 25, None, None),
        ("24:00:00:00", 25, None, None),
        ("noon", 25, None, None),
        ("", 25, None, None),
    ],
)
def test_timecode_is_real_time(text, rate, counted, seconds):
    label = read_label(text, Fraction(rate), counted)
    assert (None if label is None else label.seconds) == seconds


@pytest.mark.parametrize("suffix", [".mov", ".mp4"])
def test_timecode_tracks_align_recordings(film, tmp_path, suffix):
    codes = {"a": "10:00:00:00", "b": "10:00:00:10", "c": "09:59:59:20"}
    files = {
        name: film(tmp_path / f"{name}{suffix}", times(30), timecode=code, rate=25)
        for name, code in codes.items()
    }
    with open_files(rig(*files), files) as capture:
        stamps = stamps_of(capture)
        assert capture.starts == {"a": 200 * MS, "b": 600 * MS, "c": 0}
    assert {name: own[:2] for name, own in stamps.items()} == {
        "a": [200 * MS, 240 * MS],
        "b": [600 * MS, 640 * MS],
        "c": [0, 40 * MS],
    }
    (line,) = capture.notices
    assert line.startswith("recordings are aligned by the timecode of their first frames: 10:00:00:00 (a), ")
    with open_files(rig(*files), {"b": files["b"]}, starts=capture.starts) as alone:
        assert stamps_of(alone)["b"] == stamps["b"]
    with open_files(rig(*files), files, frame_rate=25.0) as counted:
        assert {own[0] for own in stamps_of(counted).values()} == {0} and not counted.starts
    with open_files(rig("a"), {"a": files["a"]}, stamps={"a": list(range(30))}) as stamped:
        assert stamps_of(stamped)["a"][:3] == [0, 1, 2] and not stamped.starts


def test_midnight_lies_between_two_recordings(film, tmp_path):
    codes = {"a": "00:00:00:05", "b": "23:59:59:20"}
    files = {
        name: film(tmp_path / f"{name}.mov", times(30), timecode=code, rate=25)
        for name, code in codes.items()
    }
    with open_files(rig(*files), files) as capture:
        assert capture.starts == {"a": 400 * MS, "b": 0}


@pytest.mark.parametrize(
    ("codes", "says"),
    [
        ({"a": "10:00:00:00", "b": ""}, "10:00:00:00 (a), is not used: b have none"),
        ({"a": "10:00:00:00", "b": "10:00:00:00"}, "the timecode of all first frames is 10:00:00:00 (a, b)"),
        ({"a": "10:00:00:00", "b": "11:00:00:00"}, "the recordings would never overlap"),
    ],
)
def test_timecode_that_tells_nothing_is_reported(film, tmp_path, codes, says):
    files = {
        name: film(tmp_path / f"{name}.mov", times(), timecode=code, rate=25) for name, code in codes.items()
    }
    with open_files(rig(*files), files) as capture:
        assert {own[0] for own in stamps_of(capture).values()} == {0}
    assert len(capture.notices) == 1 and says in capture.notices[0]


@pytest.mark.parametrize("reordered", [0, 2])
@pytest.mark.parametrize("suffix", [".mp4", ".mov", ".mkv"])
def test_a_late_start_counts_from_the_beginning_of_the_recording(film, tmp_path, suffix, reordered):
    late = {"a": 0, "b": 5 * FRAME}
    files = {
        name: film(tmp_path / f"{name}{suffix}", times(20, begin), rate=25, reordered=reordered)
        for name, begin in late.items()
    }
    with open_files(rig(*files), files) as capture:
        stamps = stamps_of(capture)
    assert stamps["a"] == [40 * MS * k for k in range(20)]
    assert stamps["b"] == [200 * MS + 40 * MS * k for k in range(20)]
    assert [line for line in capture.notices if "b begins 0.2 s after the first, as its file states" in line]


def test_delays_of_encoders_are_no_late_starts(film, tmp_path):
    """Matroska counts the delay of frames that are reordered in."""
    files = {
        "a": film(tmp_path / "a.mkv", times(20), rate=25, reordered=3),
        "b": film(tmp_path / "b.mkv", times(20), rate=25),
        "c": film(tmp_path / "c.mp4", times(20, 1200), rate=25),  # a third of a period
        "d": film(tmp_path / "d.ts", times(20), rate=25, reordered=3),  # from 1.4 s on
    }
    with open_files(rig(*files), files) as capture:
        assert all(own == [40 * MS * k for k in range(20)] for own in stamps_of(capture).values())
    assert capture.notices == ()


@pytest.mark.parametrize("told", [True, False])
def test_matroska_whose_times_begin_late_has_all_its_frames(film, tmp_path, told):
    path = film(tmp_path / "a.mkv", times(40, 250 * FRAME), rate=25)
    if not told:
        path.write_bytes(path.read_bytes().replace(b"DURATION", b"DURATIOM"))
    source = VideoSource("a", path)
    assert (source.frame_count, source.late, len(list(source))) == (40, 10, 40)
    files = {"a": path, "b": film(tmp_path / "b.mp4", times(40), rate=25)}
    with open_files(rig(*files), files) as capture:
        assert stamps_of(capture)["a"] == stamps_of(capture)["b"]
    (line,) = capture.notices
    told = "a begins 10 s after the first, as its file states; but then the recordings would never overlap"
    assert told in line


def test_numbers_of_images_are_frames(film, tmp_path):
    images(tmp_path / "a", [*range(1, 10), *range(14, 21)])
    film(tmp_path / "b.mp4", times(20), rate=25)
    with open_capture_folder(tmp_path, rig=rig("a", "b"), frame_rate=25.0) as capture:
        stamps = stamps_of(capture)
    assert stamps["a"] == [40 * MS * (number - 1) for number in [*range(1, 10), *range(14, 21)]]
    assert stamps["b"] == [40 * MS * k for k in range(20)]
    assert capture.notices == (
        "camera a: 4 image numbers are missing (10 to 13): the other images keep the places of their numbers",
    )


def test_folders_whose_first_images_are_missing_begin_later(tmp_path):
    images(tmp_path / "a", range(10), "a_{:d}_left.bmp")
    images(tmp_path / "b", [3, 4, 5, 7, 8, 9])
    with open_capture_folder(tmp_path, rig=rig("a", "b"), frame_rate=10.0) as capture:
        stamps = stamps_of(capture)
    assert stamps["a"] == [100 * MS * k for k in range(10)]
    assert stamps["b"] == [100 * MS * k for k in (3, 4, 5, 7, 8, 9)]
    assert len(capture.notices) == 2
    assert "b begins 0.3 s after the first, as its images are" in capture.notices[1]


def test_numbers_that_cannot_be_frames_are_not_used(tmp_path):
    images(tmp_path / "times", [1000, 1033, 1068, 1099, 1135])
    uneven = ImageFolderSource("a", tmp_path / "times", frame_rate=10.0)
    assert [frame.stamp_ns for frame in uneven] == [100 * MS * k for k in range(5)]
    assert "uneven" in uneven.notices[0] and "timestamps.csv" in uneven.notices[0]
    images(tmp_path / "tenth", [0, 10, 20, 50])  # every tenth frame, and two are missing
    tenth = ImageFolderSource("a", tmp_path / "tenth", frame_rate=10.0)
    assert [frame.stamp_ns for frame in tenth] == [0, 100 * MS, 200 * MS, 500 * MS]
    images(tmp_path / "far" / "a", range(5))
    images(tmp_path / "far" / "b", range(1000, 1005))
    with open_capture_folder(tmp_path / "far", rig=rig("a", "b")) as capture:
        assert {own[0] for own in stamps_of(capture).values()} == {0}
    assert any("never overlap" in notice for notice in capture.notices)
    stamped = ImageFolderSource("a", tmp_path / "tenth", stamps=[1, 2, 3, 4])
    assert [frame.stamp_ns for frame in stamped] == [1, 2, 3, 4] and stamped.notices == ()


def test_the_number_is_where_names_differ():
    assert image_numbers(["cam2_0001", "cam2_0003"]) == [1, 3]
    assert image_numbers(["1_cam2", "10_cam2"]) == [1, 10]
    assert image_numbers(["1_2", "2_3"]) == image_numbers(["a", "b"]) == image_numbers(["a1", "a"]) == []
    assert image_numbers(["7"]) == image_numbers(["9" * 30, "8" * 30]) == []


def test_a_table_of_caliscope_stamps_a_run(film, tmp_path):
    late = {"0": 0, "1": 3}
    rows = [f"{name},{25 + 0.04 * (k + begin):.7f}" for name, begin in late.items() for k in range(20)]
    for name in late:
        film(tmp_path / f"cam_{name}.mp4", times(20), rate=25)
    (tmp_path / "timestamps.csv").write_text("\n".join(["cam_id,frame_time", *rows]))
    with open_capture_folder(tmp_path, rig=rig("cam_0", "cam_1")) as capture:
        stamps = stamps_of(capture)
    assert stamps["cam_0"][0] == 25 * 10**9 and stamps["cam_1"][0] == 25 * 10**9 + 120 * MS
    (tmp_path / "timestamps.csv").write_text("\n".join(["cam_id,frame_time", *rows[:20]]))
    with pytest.raises(DataError, match="has stamps for cam_0 but none for camera cam_1"):
        open_capture_folder(tmp_path, rig=rig("cam_0", "cam_1"))


def test_frames_that_a_device_did_not_stamp_are_left_out(film, tmp_path):
    film(tmp_path / "port_0.mp4", times(6), rate=25)
    rows = [f"0,{k},{1 + 0.04 * k}" for k in (0, 1, 3, 5)]
    (tmp_path / "frame_time_history.csv").write_text("\n".join(["port,frame_index,frame_time", *rows]))
    with open_capture_folder(tmp_path, rig=rig("port_0")) as capture:
        frames = list(capture.sources[0])
    assert [frame.frame_number for frame in frames] == [0, 1, 3, 5]
    assert [frame.stamp_ns for frame in frames] == [10**9 + 40 * MS * k for k in (0, 1, 3, 5)]


@pytest.mark.parametrize("numbers", [range(26, 32), (26, 27, 28, 30, 31, 33)])
def test_a_device_that_counted_before_the_recording_stamps_every_frame(film, tmp_path, numbers):
    rows = []
    for name in "01":
        film(tmp_path / f"cam_{name}.mp4", times(6), rate=25)
        rows += [f"{number},{name},{number},{1 + 0.04 * number}" for number in numbers]
    (tmp_path / "timestamps.csv").write_text("\n".join(["sync_index,cam_id,frame_index,frame_time", *rows]))
    with open_capture_folder(tmp_path, rig=rig("cam_0", "cam_1")) as capture:
        assert stamps_of(capture)["cam_1"] == [10**9 + 40 * MS * number for number in numbers]
        (line,) = [text for text in capture.notices if "table of stamps" in text]
    assert line.startswith(f"cameras cam_0, cam_1: numbers 26 to {numbers[-1]} of the table")
