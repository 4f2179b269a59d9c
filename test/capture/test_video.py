"""Videos: every frame once, upright, at the right time; one clear line when something is wrong."""

from fractions import Fraction
from itertools import pairwise

import av
import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from panoptic_ros.capture import movie
from panoptic_ros.capture.source import FrameSource, exact_rate, grid_stamp
from panoptic_ros.capture.video import VideoSource, _Timeline
from panoptic_ros.errors import ConfigError, DataError, EnvironmentProblem, UserError


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
    """Times that a file rounds to ms (or finer, where they are not whole ms)."""
    timeline = _Timeline(Fraction(rate), False, Fraction(1, 1000))
    exact = [None if t is None else Fraction(t).limit_denominator(10**6) for t in container]
    return [float(timeline.step(i, t)) for i, t in enumerate(exact)], timeline.repaired


def test_rounded_container_times_are_set_to_the_grid_even_after_lost_frames():
    got, repaired = _times(30, [4.0, 4.033, 4.067, 4.1, 4.2, 4.233])  # one frame was left out
    assert got == pytest.approx([0, 1 / 30, 2 / 30, 3 / 30, 6 / 30, 7 / 30], abs=1e-12) and repaired == 0


def test_varying_times_are_kept():
    container = [0.0, 0.033, 0.081, 0.100, 0.166]
    got, repaired = _times(30, container)
    assert got == pytest.approx([0, 1 / 30, *container[2:]], abs=1e-12) and repaired == 0


def test_times_that_do_not_increase_are_repaired_and_counted():
    got, repaired = _times(10, [0.0, 0.0, 0.0, None])
    assert got == pytest.approx([0, 0.1, 0.2, 0.3]) and repaired == 3


@given(st.lists(st.floats(0, 100), min_size=1, max_size=30), st.integers(1, 240))
def test_times_always_increase(container, rate):
    got, _ = _times(rate, container)
    assert got[0] == 0 and all(a < b for a, b in pairwise(got))


VARYING = [0, 3000, 6100, 9000, 15003, 15500, 21007, 90000]  # of 1/90000 s; a phone in the dark


@pytest.mark.parametrize("first", [0, 1234])
@pytest.mark.parametrize(("suffix", "tick"), [("mp4", Fraction(1, 90000)), ("mkv", Fraction(1, 1000))])
def test_a_variable_rate_file_keeps_its_times(film, tmp_path, suffix, tick, first):
    path = film(tmp_path / f"a.{suffix}", [first + time for time in VARYING])
    source = VideoSource("cam", path, start_ns=7)
    got = [frame.stamp_ns for frame in source]
    exact = [7 + round(Fraction(time, 90000) * 10**9) for time in VARYING]
    rounding = 1 if suffix == "mp4" else 2 * tick * 10**9  # of the first frame's time, and of this one's
    assert source.repaired_stamps == 0
    assert np.abs(np.subtract(got, exact)).max() <= rounding


def test_jitter_below_a_millisecond_is_kept_where_the_file_has_finer_times(film, tmp_path):
    times = [3000 * i + jitter for i, jitter in enumerate([0, 0, 31, -40, 55, 17, -61, 8, 29, -13])]
    got = [frame.stamp_ns for frame in VideoSource("cam", film(tmp_path / "a.mp4", times))]
    assert got == [round(Fraction(time, 90000) * 10**9) for time in times]


def test_times_that_were_once_rounded_to_milliseconds_are_set_to_the_grid(film, tmp_path):
    times = [90 * round(i * 1000 / 30) for i in range(40)]  # Matroska, copied to MP4
    got = [frame.stamp_ns for frame in VideoSource("cam", film(tmp_path / "a.mp4", times))]
    assert got == [round(Fraction(i, 30) * 10**9) for i in range(40)]


@pytest.mark.parametrize("clockwise", [90, 180, 270])
def test_a_turned_video_is_upright_and_told_of(film, tmp_path, clockwise):
    path = film(tmp_path / "a.mp4", [0, 3000], clockwise=clockwise)
    plain = next(iter(VideoSource("cam", film(tmp_path / "b.mp4", [0, 3000])))).image
    source = VideoSource("cam", path)
    image = next(iter(source)).image
    assert np.array_equal(image, np.rot90(plain, -clockwise // 90))
    assert source.image_size == image.shape[1::-1]
    assert source.notices == (f"images are turned clockwise by {clockwise} degrees, as marked in the file",)
    assert VideoSource("cam", tmp_path / "b.mp4").notices == ()


@pytest.mark.parametrize(
    ("codec", "layout", "size"),
    [
        ("libx264", "yuv420p", (64, 48)),
        ("libx264", "yuv444p", (70, 50)),
        ("mjpeg", "yuvj422p", (70, 48)),
        ("ffv1", "gray", (64, 48)),
        ("libx265", "yuv420p10le", (64, 48)),
        ("vp9", "yuv420p", (96, 64)),
    ],
)
def test_images_are_those_of_opencv(film, tmp_path, codec, layout, size):
    path = film(tmp_path / "a.mkv", [3000 * i for i in range(4)], codec=codec, layout=layout, size=size)
    capture = cv2.VideoCapture(str(path))
    for frame in VideoSource("cam", path):
        assert np.array_equal(frame.image, capture.read()[1])
    assert frame.frame_number == 3 and not capture.read()[0]


def test_a_raw_stream_needs_a_rate(film, tmp_path):
    path = film(tmp_path / "a.h264", [3000 * i for i in range(5)])
    with pytest.raises(DataError, match="raw stream without times") as caught:
        VideoSource("cam", path)
    assert "\n" not in str(caught.value)
    assert [f.stamp_ns for f in VideoSource("cam", path, frame_rate=5.0)] == [2 * 10**8 * i for i in range(5)]
    assert [f.stamp_ns for f in VideoSource("cam", path, stamps=[1, 2, 3, 5, 8])] == [1, 2, 3, 5, 8]


def test_sound_alone_is_no_video(tmp_path):
    path = tmp_path / "a.mp4"
    with av.open(str(path), "w") as file:
        stream = file.add_stream("aac", rate=48000)
        sound = av.AudioFrame.from_ndarray(np.zeros((1, 4800), np.float32), format="fltp", layout="mono")
        sound.sample_rate = 48000
        file.mux(stream.encode(sound) + stream.encode())
    with pytest.raises(DataError, match=r"no video track \(audio only\)"):
        VideoSource("cam", path)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (None, "does not exist"),
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
@pytest.mark.parametrize("codec", [("a.mp4", "mp4v"), ("a.avi", "MJPG"), ("a.mkv", "mp4v")])
def test_a_cut_off_file_is_refused_up_front(make_video, tmp_path, part, codec):
    path = make_video(tmp_path / codec[0], 30, codec=codec[1])
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * part)])
    with pytest.raises(DataError, match=r"cut off|cannot be opened"):
        VideoSource("cam", path)


def test_a_cut_off_matroska_of_unknown_size_gives_its_good_frames_and_then_complains(make_video, tmp_path):
    path = make_video(tmp_path / "a.mkv", 200)
    data = bytearray(path.read_bytes())
    size = data.index(bytes.fromhex("18538067")) + 4
    assert data[size] == 1  # eight bytes; all ones: a stream, whose end nobody knew
    data[size : size + 8] = b"\x01" + 7 * b"\xff"
    path.write_bytes(data[: len(data) // 2])
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


def test_hardware_decodes_where_it_is_asked_for(make_video, tmp_path, monkeypatch):
    """With a stand-in for the hardware, as FFmpeg's decoders give the same images wherever they run."""
    path, opened = make_video(tmp_path / "a.mp4", 5), []
    expected = [frame.image for frame in VideoSource("cam", path)]
    plain = av.open

    def opening(file, *mode, hwaccel=None, **more):
        opened.append(hwaccel)
        return plain(file, *mode, **more)

    monkeypatch.setattr(movie, "hwdevices_available", lambda: ["cuda"])
    monkeypatch.setattr(av, "open", opening)
    with VideoSource("cam", path, hardware="cuda") as source:
        assert all(np.array_equal(a.image, b) for a, b in zip(source, expected, strict=True))
    used = [accelerator for accelerator in opened if accelerator is not None]
    assert len(used) == 2 and not any(accelerator.allow_software_fallback for accelerator in used)


def test_hardware_that_is_not_there_is_told_and_nothing_else_is_taken(make_video, tmp_path, monkeypatch):
    path = make_video(tmp_path / "a.mp4", 5)
    with pytest.raises(EnvironmentProblem, match="FFmpeg does not support steam here; there are"):
        VideoSource("cam", path, hardware="steam")

    def refuse(*given, hwaccel=None, plain=av.open, **more):
        if hwaccel is not None:
            raise RuntimeError("no stream is compatible")
        return plain(*given, **more)

    monkeypatch.setattr(movie, "hwdevices_available", lambda: ["cuda"])
    monkeypatch.setattr(av, "open", refuse)
    with pytest.raises(EnvironmentProblem, match="a.mp4 of camera cam: cuda does not decode it on this mach"):
        VideoSource("cam", path, hardware="cuda")
