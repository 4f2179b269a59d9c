"""Damaged files: told with the remedy, or, where that is allowed, what is damaged is left out and counted."""

import av
import cv2
import numpy as np
import pytest
from numbered_images import number_of

from panoptic_ros.capture.folder import open_files
from panoptic_ros.capture.image_folder import ImageFolderSource
from panoptic_ros.capture.video import VideoSource
from panoptic_ros.domain import Camera, Rig
from panoptic_ros.errors import DataError
from panoptic_ros.geometry import Intrinsics, Rigid

COUNT, GOP = 40, 10
BLOCK = 10  # bytes of the head of a block of Matroska
SECOND = 10**9


def packets_of(path):
    """(place in the file, size) of each packet of a video, as they are stored."""
    with av.open(str(path)) as file:
        return [(packet.pos, packet.size) for packet in file.demux(video=0) if packet.size]


def spoil(path, numbers, part=slice(None)):
    """Overwrite what packets hold."""
    data = bytearray(path.read_bytes())
    places = packets_of(path)
    for number in numbers:
        at, size = places[number]
        inside = range(at, at + size)[part]
        data[inside.start : inside.stop] = bytes(len(inside))
    path.write_bytes(data)
    return path


def left_by(path, lost):
    """Numbers of the frames before lost ones, and from the next that builds on no other on."""
    with av.open(str(path)) as file:
        keys = [packet.is_keyframe for packet in file.demux(video=0) if packet.size]
    broken, left = False, []
    for number, key in enumerate(keys):
        broken = number in lost or (broken and not key)
        left += [] if broken else [number]
    return left


@pytest.fixture
def video(film, tmp_path):
    """A video of numbered images, with a key frame every ten."""

    def make(name="a.mp4", codec="libx264", **more):
        times = [3000 * k for k in range(COUNT)]
        return film(tmp_path / name, times, numbered=True, gop=GOP, codec=codec, **more)

    return make


@pytest.mark.parametrize(
    ("name", "codec"), [("a.mp4", "libx264"), ("a.mkv", "libx264"), ("a.avi", "mpeg4"), ("a.mov", "mjpeg")]
)
def test_lost_frames_end_a_file_or_are_left_out(video, name, codec):
    more = {"layout": "yuvj420p"} if codec == "mjpeg" else {}
    path = video(name, codec, **more)
    expected = left_by(path, {13, 14})
    spoil(path, [13, 14], slice(BLOCK if name.endswith("mkv") else 0, None))
    with pytest.raises(DataError, match="frames could not be decoded|frames could be decoded") as caught:
        list(VideoSource("cam", path))
    assert "--skip-damaged" in str(caught.value) and "\n" not in str(caught.value)
    source = VideoSource("cam", path, skip_damaged=True)
    frames = list(source)
    assert [frame.frame_number for frame in frames] == expected
    assert [frame.stamp_ns for frame in frames] == [round(k * SECOND / 30) for k in expected]
    assert [number_of(frame.image) for frame in frames] == expected
    (told,) = source.after
    lost = COUNT - len(expected)
    assert told.code == "source.damaged" and f"{lost} of {COUNT} frames are damaged and left out" in told.text
    assert told.values == {"device": "cam"}


def test_stamps_stay_with_their_frames(video):
    source = VideoSource("cam", spoil(video(), [23]), stamps=range(100, 100 + COUNT), skip_damaged=True)
    assert [frame.stamp_ns - 100 for frame in source] == [k for k in range(COUNT) if not 23 <= k < 30]


def test_frames_that_are_damaged_in_parts_are_told(video):
    path = spoil(video("a.ts", "mpeg2video", size=(176, 144)), [])
    data = bytearray(path.read_bytes())
    middle = len(data) // 2 // 188 * 188
    data[middle + 20 : middle + 180] = bytes(160)  # of a packet of the stream
    path.write_bytes(data)
    source = VideoSource("cam", path)
    try:
        assert len(list(source)) == COUNT
    except DataError as error:
        assert "--skip-damaged" in str(error)
    else:
        assert (
            "frames are damaged in parts; leave out the damaged frames with --skip-damaged"
            in source.after[0].text
        )
    skipping = VideoSource("cam", path, skip_damaged=True)
    frames = list(skipping)
    assert COUNT - GOP - 2 <= len(frames) < COUNT
    assert all(number_of(frame.image) == frame.frame_number for frame in frames)
    assert f"{COUNT - len(frames)} of {COUNT} frames are damaged" in skipping.after[0].text


def test_a_file_that_is_cut_off_is_used_as_far_as_it_goes(film, video, tmp_path):
    path = video("a.mkv")
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 4 // 5])
    with pytest.raises(DataError, match="is cut off: .*or leave out the damaged frames with --skip-damaged"):
        VideoSource("cam", path)
    source = VideoSource("cam", path, skip_damaged=True)
    frames = list(source)
    assert 5 < len(frames) < COUNT and [frame.frame_number for frame in frames] == list(range(len(frames)))
    assert f"{COUNT - len(frames)} of {COUNT} frames are damaged" in source.after[0].text


def test_times_that_are_repaired_are_told(film, tmp_path):
    path = film(tmp_path / "a.avi", [3000 * k for k in range(20)], codec="mpeg4", reordered=2, numbered=True)
    source = VideoSource("cam", path)
    frames = list(source)
    assert [number_of(frame.image) for frame in frames] == list(range(20))
    assert [frame.stamp_ns for frame in frames] == [round(k * SECOND / 30) for k in range(20)]
    assert source.repaired_stamps == 0 and source.after == ()
    source._next = lambda *given: None  # nothing more comes
    source.repaired_stamps = 3
    source._tell(source._open(look=True), 20, 0, frames[-1].stamp_ns)
    source.close()
    (told,) = source.after
    assert told.code == "source.repaired" and "3 frames have times that do not increase" in told.text


@pytest.mark.parametrize("codec", ["libx264", "mpeg4"])
def test_frames_of_avi_that_are_reordered_lie_where_their_number_says(film, tmp_path, codec):
    times = [3600 * k for k in range(30)]
    path = film(tmp_path / "a.avi", times, codec=codec, reordered=2, numbered=True, rate=25)
    frames = list(VideoSource("cam", path))
    assert [number_of(frame.image) for frame in frames] == list(range(30))
    assert [frame.stamp_ns for frame in frames] == [40_000_000 * k for k in range(30)]


def test_damaged_images_are_left_out_and_counted(tmp_path):
    for k in range(4):
        cv2.imwrite(str(tmp_path / f"{k}.png"), np.full((48, 64, 3), k, np.uint8))
    (tmp_path / "0.png").write_bytes(b"nothing")
    (tmp_path / "2.png").write_bytes(b"")
    with pytest.raises(DataError, match=r"0\.png is not an image .*--skip-damaged"):
        ImageFolderSource("cam", tmp_path)
    source = ImageFolderSource("cam", tmp_path, frame_rate=10.0, skip_damaged=True)
    assert [(frame.frame_number, 10 * frame.stamp_ns // SECOND) for frame in source] == [(1, 1), (3, 3)]
    assert "2 of 4 images are damaged and left out" in source.after[0].text


def test_what_is_known_after_the_last_frame_passes_through(video):
    lens = Intrinsics([[50.0, 0.0, 30.0], [0.0, 55.0, 25.0], [0.0, 0.0, 1.0]], [])
    rig = Rig((Camera("cam", (64, 48), lens, Rigid.identity()),))
    line = {"offset_ns": 500_000_000, "drift": 0.0, "reference_ns": 0}
    files = {"cam": spoil(video(), [13])}
    with open_files(rig, files, corrections={"cam": line}, skip_damaged=True) as capture:
        (source,) = capture.sources
        frames = list(source)
        assert len(frames) == COUNT - 7 and source.after[0].code == "source.damaged"
