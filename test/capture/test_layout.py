"""Capture folders of other programs: where their files lie, and whose they are."""

import cv2
import numpy as np
import pytest

from panoptic_ros.capture.folder import open_capture_folder
from panoptic_ros.capture.layout import VIDEO_SUFFIXES, has_media, named_as
from panoptic_ros.domain import Camera, Rig
from panoptic_ros.errors import CalibrationError, DataError
from panoptic_ros.geometry import Intrinsics, Rigid

SIZE = (64, 48)


def rig(*names, types=None):
    lens = Intrinsics([[50.0, 0.0, 30.0], [0.0, 55.0, 25.0], [0.0, 0.0, 1.0]], [])
    kinds = types or [""] * len(names)
    return Rig(tuple(Camera(n, SIZE, lens, Rigid.identity(), type=kind) for n, kind in zip(names, kinds)))


def images(folder, count=2, suffix=".png", value=90):
    folder.mkdir(parents=True, exist_ok=True)
    for k in range(count):
        assert cv2.imwrite(str(folder / f"{k}{suffix}"), np.full((48, 64, 3), value, np.uint8))
    return folder


@pytest.mark.parametrize(
    ("cameras", "names", "meant"),
    [
        (["a", "b"], ["b", "a", "c"], {"a": "a", "b": "b"}),
        (
            ["int_cam01_img", "int_cam02_img"],
            ["cam01", "cam02"],
            {"cam01": "int_cam01_img", "cam02": "int_cam02_img"},
        ),
        (["00_00", "00_01"], ["hd_00_01", "hd_00_00"], {"hd_00_00": "00_00", "hd_00_01": "00_01"}),
        (["cam_0", "cam_1", "cam_10"], ["0", "1", "10"], {"0": "cam_0", "1": "cam_1", "10": "cam_10"}),
        (["CAM1", "CAM2"], ["cam02", "cam01"], {"cam01": "CAM1", "cam02": "CAM2"}),
        (["cam_0", "cam_1"], ["port_0", "port_1"], {"port_0": "cam_0", "port_1": "cam_1"}),
        (["cam_0"], ["port_0", "port_1", "port_2"], {"port_0": "cam_0"}),  # of several, opened alone
        (["cam0", "cam1"], ["video1", "video2"], {}),  # counted from another number
        (["a1_b1", "a1_b2"], ["a1"], {}),  # fits two
        (["cam1"], ["1", "cam_1"], {}),  # two fit it
        (["left", "right"], ["l", "r"], {}),
        (["left"], ["left_eye"], {}),  # no number
        (["cam"], ["video"], {}),
    ],
)
def test_a_name_means_the_only_camera_that_fits(cameras, names, meant):
    assert named_as(cameras, names) == meant


def test_a_video_of_the_only_camera_that_fits_is_taken_and_told(make_video, tmp_path):
    for name in ("cam01", "cam02"):
        make_video(tmp_path / f"{name}.mp4", 3)
    with open_capture_folder(tmp_path, rig=rig("int_cam02_img", "int_cam01_img")) as capture:
        assert [source.path.stem for source in capture.sources] == ["cam02", "cam01"]
    pairs = "cam01.mp4 as int_cam01_img, cam02.mp4 as int_cam02_img"
    assert capture.notices == (f"files are taken as the only camera that fits: {pairs}",)
    with open_capture_folder(tmp_path, rig=capture.rig, cameras=["int_cam01_img"]) as alone:
        assert alone.sources[0].path.stem == "cam01"


def test_names_that_may_be_meant_are_offered(make_video, tmp_path):
    for name in ("video0", "video1"):
        make_video(tmp_path / f"{name}.mp4", 3)
    with pytest.raises(CalibrationError, match=r"video1\.mp4 may be cam1: rename files, or give --video"):
        open_capture_folder(tmp_path, rig=rig("cam1", "cam2"))
    make_video(tmp_path / "cam1.mp4", 3)
    (tmp_path / "video0.mp4").unlink()
    (tmp_path / "video1.mp4").unlink()
    with pytest.raises(DataError, match=r"no video cam2\.mp4 .*--cameras cam1"):
        open_capture_folder(tmp_path, rig=rig("cam1", "cam2"))


@pytest.mark.parametrize("place", ["videos", "hdVideos", "recording 3"])
def test_videos_may_lie_in_a_folder_of_their_own(make_video, make_rig_file, tmp_path, place):
    make_rig_file(tmp_path / "Calibration" / "cameras.json", {"a": SIZE, "b": SIZE})
    for name in "ab":
        make_video(tmp_path / place / f"{name}.mp4", 3)
    (tmp_path / place / "timestamps.csv").write_text(
        "camera,frame,stamp_ns\n" + "".join(f"{n},{k},{k + 7}\n" for n in "ab" for k in range(3))
    )
    (tmp_path / "results").mkdir()
    make_video(tmp_path / "results" / "overlay.mp4", 3)
    with open_capture_folder(tmp_path) as capture:
        assert [source.path.parent.name for source in capture.sources] == [place, place]
        assert [frame.stamp_ns for frame in capture.sources[1]] == [7, 8, 9]
    assert capture.notices == (f"images are taken from {tmp_path / place}",)
    assert has_media(tmp_path) == (place != "recording 3")


def test_images_of_cameras_may_lie_in_a_folder_of_their_own(tmp_path):
    for name in "ab":
        images(tmp_path / "images" / name)
        images(tmp_path / "images" / f"{name}_depth")
    with open_capture_folder(tmp_path, rig=rig("a", "b"), depth=False) as capture:
        assert [source.path for source in capture.sources] == [tmp_path / "images" / name for name in "ab"]
    with pytest.raises(DataError, match="no images c/"):
        open_capture_folder(tmp_path, rig=rig("a", "b", "c"))


def test_of_several_folders_the_one_with_videos_is_taken(make_video, tmp_path):
    for place in ("pose", "videos"):
        make_video(tmp_path / place / "a.mp4", 3)
    images(tmp_path / "images" / "a")
    with open_capture_folder(tmp_path, rig=rig("a")) as capture:
        assert capture.sources[0].path == tmp_path / "videos" / "a.mp4"
    make_video(tmp_path / "trial1" / "b.mp4", 3)
    make_video(tmp_path / "trial2" / "b.mp4", 3)
    with pytest.raises(DataError, match="camera b has both .*trial1.* and .*trial2.*give the folder that is"):
        open_capture_folder(tmp_path, rig=rig("a", "b"))


def test_folders_of_the_studio_hold_cameras_of_their_type(make_video, tmp_path):
    for name in ("hd_00_00", "hd_00_01"):
        make_video(tmp_path / "hdVideos" / f"{name}.mp4", 3)
    whole = rig("00_00", "00_01", "01_01", "50_01", types=["hd", "hd", "vga", "kinect-color"])
    with open_capture_folder(tmp_path, rig=whole) as capture:
        assert capture.rig.names == ("00_00", "00_01")
    assert "2 cameras of type kinect, vga have no folder of their kind: left out" in capture.notices
    make_video(tmp_path / "vgaVideos" / "vga_01_01.mp4", 3)
    with open_capture_folder(tmp_path, rig=whole) as capture:
        assert capture.rig.names == ("00_00", "00_01", "01_01")
    (tmp_path / "hdVideos" / "hd_00_01.mp4").unlink()
    with pytest.raises(DataError, match=r"no video 00_01\.mp4 .*--cameras 00_00,01_01"):
        open_capture_folder(tmp_path, rig=whole)


@pytest.mark.parametrize("suffix", [".ts", ".MTS", ".m2ts", ".mxf", ".wmv", ".flv", ".3gp", ".mpg", ".webm"])
def test_containers_are_known_by_their_endings(film, tmp_path, suffix):
    codec = {".wmv": "wmv2", ".flv": "flv", ".mxf": "mpeg2video", ".mpg": "mpeg2video", ".webm": "libvpx"}
    film(
        tmp_path / f"a{suffix}",
        [3600 * k for k in range(10)],
        codec=codec.get(suffix.lower(), "libx264"),
        size=(176, 144),
        rate=25,
    )
    lens = rig("a").cameras[0].intrinsics
    wide = Rig((Camera("a", (176, 144), lens, Rigid.identity()),))
    with open_capture_folder(tmp_path, rig=wide) as capture:
        assert [frame.stamp_ns for frame in capture.sources[0]] == [40_000_000 * k for k in range(10)]


def test_raw_streams_need_a_rate(film, tmp_path):
    assert {".h264", ".hevc", ".mjpeg"} <= set(VIDEO_SUFFIXES)
    film(tmp_path / "a.h264", [3600 * k for k in range(5)])
    with pytest.raises(DataError, match="raw stream without times of its frames; give one .--frame-rate"):
        open_capture_folder(tmp_path, rig=rig("a"))
    with open_capture_folder(tmp_path, rig=rig("a"), frame_rate=25.0) as capture:
        assert [frame.stamp_ns for frame in capture.sources[0]] == [40_000_000 * k for k in range(5)]


@pytest.mark.parametrize("suffix", [".bmp", ".tif", ".tiff", ".TIFF", ".webp", ".jpg", ".png"])
def test_images_are_known_by_their_endings(tmp_path, suffix):
    images(tmp_path / "a", 3, suffix, value=120)
    with open_capture_folder(tmp_path, rig=rig("a")) as capture:
        frames = list(capture.sources[0])
    assert len(frames) == 3 and all(np.abs(frame.image.astype(int) - 120).max() <= 3 for frame in frames)


def test_recordings_farther_in_are_named_with_what_to_give(make_video, tmp_path):
    for name in ("cam_0", "cam_1"):
        make_video(tmp_path / "recordings" / "take_1" / f"{name}.mp4", 3)
    with pytest.raises(DataError, match=r"take_1 has one: give that folder, and the rig with --rig$"):
        open_capture_folder(tmp_path, rig=rig("cam_0", "cam_1"))
