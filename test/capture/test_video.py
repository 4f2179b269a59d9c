"""Videos: every frame once, upright, at the right time; one clear line when something is wrong."""
import struct
from fractions import Fraction
from itertools import pairwise

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from panoptic_ros.capture.source import FrameSource, exact_rate, grid_stamp
from panoptic_ros.capture.video import VideoSource, _Timeline
from panoptic_ros.errors import ConfigError, DataError, UserError


@pytest.mark.parametrize(
    ("name", "codec"), [("a.mp4", "mp4v"), ("a.avi", "MJPG"), ("a.mkv", "mp4v"), ("a.mov", "mp4v")]
)
@pytest.mark.parametrize("rate", [23.976, 29.97, 60.0])
def test_all_frames_come_once_and_in_order_at_exact_times(make_video, tmp_path, name, codec, rate):
    source = VideoSource("cam", make_video(tmp_path / name, 12, rate=rate, codec=codec), start_ns=5)
    frames = list(source)
    assert isinstance(source, FrameSource)
    assert (source.image_size, source.frame_count, len(frames)) == ((64, 48), 12, 12)
    assert [frame.frame_number for frame in frames] == list(range(12))
    exact = exact_rate(source.frame_rate, "test")
    assert float(exact) == pytest.approx(rate, rel=1e-4)
    assert [frame.stamp_ns for frame in frames] == [5 + round(i * 10**9 / exact) for i in range(12)]
    red = [frame.image[24, 16, 2] for frame in frames]
    assert np.abs(np.array(red) - (40 + 4 * np.arange(12))).max() <= 6


def test_a_second_reading_gives_the_same(make_video, tmp_path):
    with VideoSource("cam", make_video(tmp_path / "a.mp4", 5)) as source:
        first, second = list(source), list(source)
    assert [f.stamp_ns for f in first] == [f.stamp_ns for f in second]
    assert all(np.array_equal(a.image, b.image) for a, b in zip(first, second))


@pytest.mark.parametrize("degrees", [90, 180, 270])
def test_the_rotation_mark_is_obeyed(make_video, patch_track_header, tmp_path, degrees):
    path = patch_track_header(make_video(tmp_path / "a.mp4", 3), degrees, (64, 48))
    source = VideoSource("cam", path)
    assert source.image_size == ((64, 48) if degrees == 180 else (48, 64))
    image = next(iter(source)).image
    assert image.shape[1::-1] == source.image_size
    # red was on the left: clockwise turns bring it up, to the right, down
    far_x, far_y = source.image_size[0] - 9, source.image_size[1] - 9
    red_at = {90: (far_x // 2, 8), 180: (far_x, far_y // 2), 270: (far_x // 2, far_y)}[degrees]
    assert image[red_at[1], red_at[0], 2] > 25 > image[red_at[1], red_at[0], 0]


def test_given_frame_rate_and_given_stamps_replace_the_files_times(make_video, tmp_path):
    path = make_video(tmp_path / "a.mp4", 4)
    source = VideoSource("cam", path, frame_rate=100.0)
    assert [frame.stamp_ns for frame in source] == [0, 10**7, 2 * 10**7, 3 * 10**7]
    stamps = [7, 11, 13, 400]
    assert [f.stamp_ns for f in VideoSource("cam", path, start_ns=99, stamps=stamps)] == stamps
    with pytest.raises(DataError, match="has 4 frames but 3 stamps"):
        VideoSource("cam", path, stamps=stamps[:3])
    with pytest.raises(DataError, match="the stamp of frame 2"):
        VideoSource("cam", path, stamps=[1, 2, 2, 3])
    with pytest.raises(ConfigError, match="frame rate 0"):
        VideoSource("cam", path, frame_rate=0.0)


def test_no_drift_over_a_day():
    rate = exact_rate(30000 / 1001, "test")
    assert rate == Fraction(30000, 1001)
    frames = 24 * 3600 * 30
    assert grid_stamp(0, frames, rate) == round(Fraction(frames * 1001 * 10**9, 30000))


def _times(rate, container):
    timeline = _Timeline(Fraction(rate), False)
    return [float(timeline.step(i, t)) for i, t in enumerate(container)], timeline.repaired


def test_rounded_container_times_are_set_to_the_grid_even_after_lost_frames():
    got, repaired = _times(30, [4.0, 4.033, 4.067, 4.1, 4.2, 4.233])  # one frame was left out
    assert got == pytest.approx([0, 1 / 30, 2 / 30, 3 / 30, 6 / 30, 7 / 30], abs=1e-12) and repaired == 0


def test_varying_times_are_kept():
    container = [0.0, 0.033, 0.081, 0.100, 0.166]
    got, repaired = _times(30, container)
    assert got == pytest.approx([0, 1 / 30, *container[2:]], abs=1e-12) and repaired == 0


def test_times_that_do_not_increase_are_repaired_and_counted():
    got, repaired = _times(10, [0.0, 0.0, 0.0, float("nan")])
    assert got == pytest.approx([0, 0.1, 0.2, 0.3]) and repaired == 3


@given(st.lists(st.floats(0, 100), min_size=1, max_size=30), st.integers(1, 240))
def test_times_always_increase(container, rate):
    got, _ = _times(rate, container)
    assert got[0] == 0 and all(a < b for a, b in pairwise(got))


def test_a_variable_rate_file_keeps_its_times(make_video, tmp_path):
    path = make_video(tmp_path / "a.mp4", 6, rate=30.0)
    data = bytearray(path.read_bytes())
    at = data.index(b"stts") + 4  # one run of 6 equal durations: make it 2 runs, in the same room
    count, frames, duration = struct.unpack_from(">III", data, at + 4)
    assert (count, frames) == (1, 6)
    moov = data.index(b"moov") - 4
    data[at + 16 : at + 16] = struct.pack(">II", 3, 3 * duration)
    struct.pack_into(">III", data, at + 4, 2, 3, duration)
    for name in (b"moov", b"trak", b"mdia", b"minf", b"stbl", b"stts"):
        start = data.index(name, moov) - 4
        struct.pack_into(">I", data, start, struct.unpack_from(">I", data, start)[0] + 8)
    edits = data.index(b"edts", moov)
    data[edits : edits + 4] = b"free"  # it would end the video at its former length
    path.write_bytes(data)
    seconds = [frame.stamp_ns / 1e9 for frame in VideoSource("cam", path)]
    assert np.diff(seconds) == pytest.approx([1 / 30, 1 / 30, 1 / 30, 3 / 30, 3 / 30], abs=2e-3)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (None, "is not there"),
        (b"", "is empty"),
        (b"no video at all\n" * 50, "cannot be opened"),
    ],
)
def test_what_is_no_video_is_refused_in_one_line(tmp_path, capfd, content, says):
    path = tmp_path / "a.mp4"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(DataError, match=says) as caught:
        VideoSource("cam7", path)
    assert "a.mp4" in str(caught.value) and "cam7" in str(caught.value) and "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("part", [0.02, 0.5, 0.99])
@pytest.mark.parametrize("codec", [("a.mp4", "mp4v"), ("a.avi", "MJPG")])
def test_a_cut_off_file_is_refused_up_front(make_video, tmp_path, part, codec):
    path = make_video(tmp_path / codec[0], 30, codec=codec[1])
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * part)])
    with pytest.raises(DataError, match=r"cut off|cannot be opened"):
        VideoSource("cam", path)


def test_a_cut_off_matroska_gives_its_good_frames_and_then_complains(make_video, tmp_path):
    path = make_video(tmp_path / "a.mkv", 200)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    got = []
    with pytest.raises(DataError, match=r"only \d+ of 200 frames"):
        for frame in VideoSource("cam", path):
            got.append(frame.frame_number)
    assert 20 < len(got) < 200


def test_frames_that_are_counted_but_not_there_are_missed(make_video, tmp_path):
    path = make_video(tmp_path / "a.avi", 20, codec="MJPG")
    data = bytearray(path.read_bytes())
    index = data.rindex(b"idx1")
    for entry in range(index + 8 + 12 * 16, len(data) - 15, 16):  # the last frames' data and index vanish
        data[entry : entry + 4] = b"junk"
    tail = [at for at in range(len(data) - 4) if data[at : at + 4] == b"00dc"][12:20]
    for at in tail:
        data[at : at + 4] = b"JUNK"
    path.write_bytes(data)
    with pytest.raises(DataError, match=r"only 1\d of 20 frames"):
        list(VideoSource("cam", path))


def test_a_video_without_frames_is_refused(tmp_path):
    path = tmp_path / "a.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 30, (64, 48))
    writer.release()
    with pytest.raises(UserError, match=r"no frame|cannot be opened|empty"):
        VideoSource("cam", path)


def test_closing_ends_what_is_under_way(make_video, tmp_path):
    source = VideoSource("cam", make_video(tmp_path / "a.mp4", 10))
    frames = iter(source)
    next(frames)
    source.close()
    assert list(frames) == []
