"""Capture folders: what belongs together is found, and what does not fit is named."""

import cv2
import numpy as np
import pytest

from panoptic_ros.capture.folder import open_capture_folder, open_files
from panoptic_ros.capture.image_folder import ImageFolderSource, natural_key
from panoptic_ros.capture.image_size import fit_camera
from panoptic_ros.domain import Camera, Rig
from panoptic_ros.errors import CalibrationError, DataError
from panoptic_ros.geometry import Intrinsics, Rigid

SIZE = (64, 48)


def _camera(name="cam1", size=SIZE, centre=(30.0, 25.0)):
    matrix = [[50.0, 0.0, centre[0]], [0.0, 55.0, centre[1]], [0.0, 0.0, 1.0]]
    return Camera(name, size, Intrinsics(matrix, [0.1]), Rigid.identity())


def _rig(*names):
    return Rig(tuple(_camera(name) for name in names))


def _images(folder, count, size=SIZE):
    folder.mkdir(parents=True, exist_ok=True)
    for i in range(count):
        cv2.imwrite(str(folder / f"frame{i}.png"), np.full((size[1], size[0], 3), i, np.uint8))


def test_videos_and_images_and_stamps_come_together(make_video, make_rig_file, tmp_path):
    make_rig_file(tmp_path / "rig.json", {"b": SIZE, "a": SIZE})
    make_video(tmp_path / "a.MP4", 3)
    _images(tmp_path / "b", 3)
    (tmp_path / "b_depth").mkdir()
    (tmp_path / "mic.wav").write_bytes(b"RIFF")
    rows = [f"{camera},{i},{100 * i + (camera == 'b')}" for i in (2, 0, 1) for camera in "ab"]
    (tmp_path / "timestamps.csv").write_text("camera,frame,stamp_ns\n" + "\n".join(rows) + "\n")
    with open_capture_folder(tmp_path) as capture:
        assert capture.rig.names == ("b", "a") and [s.camera for s in capture.sources] == ["b", "a"]
        assert capture.frame_count == 6 and capture.notices == ()
        stamps = {s.camera: [f.stamp_ns for f in s] for s in capture.sources}
    assert stamps == {"a": [0, 100, 200], "b": [1, 101, 201]}


def test_images_are_in_natural_order_at_the_given_rate(tmp_path):
    _images(tmp_path / "cam", 12)
    source = ImageFolderSource("cam", tmp_path / "cam", start_ns=7, frame_rate=50.0)
    frames = list(source)
    assert [frame.image[0, 0, 0] for frame in frames] == list(range(12))
    assert [frame.stamp_ns for frame in frames] == [7 + i * 20_000_000 for i in range(12)]
    assert (source.frame_count, source.image_size, source.frame_rate) == (12, SIZE, 50.0)
    assert [f.frame_number for f in source] == list(range(12))


def test_natural_order():
    names = ["img10.png", "img9.png", "img09.png", "a2b10", "a2b9", "A1"]
    assert sorted(names, key=natural_key) == ["A1", "a2b9", "a2b10", "img09.png", "img9.png", "img10.png"]


def test_bad_images_are_named(tmp_path):
    with pytest.raises(DataError, match=r"has no images \(png, jpg"):
        ImageFolderSource("cam", tmp_path)
    _images(tmp_path / "a", 3)
    (tmp_path / "a" / "frame1.png").write_bytes(b"nothing")
    with pytest.raises(DataError, match=r"frame1\.png is not an image"):
        list(ImageFolderSource("cam", tmp_path / "a"))
    cv2.imwrite(str(tmp_path / "a" / "frame1.png"), np.zeros((10, 20, 3), np.uint8))
    with pytest.raises(DataError, match=r"frame1\.png is 20x10, the first of its folder 64x48"):
        list(ImageFolderSource("cam", tmp_path / "a"))


def test_cameras_without_a_video(make_video, tmp_path):
    make_video(tmp_path / "cam1.mp4")
    with pytest.raises(DataError, match=r"no video cam2\.mp4"):
        open_capture_folder(tmp_path, rig=_rig("cam1", "cam2"))
    assert open_capture_folder(tmp_path, rig=_rig("cam1", "cam2"), cameras=["cam1"]).rig.names == ("cam1",)
    capture = open_files(_rig("cam1", "cam2"), {"cam1": tmp_path / "cam1.mp4"})
    assert capture.notices == ("camera cam2 of the rig has no images",)


def test_an_assumed_frame_rate_is_told(make_video, make_rig_file, tmp_path):
    """Images state no rate. Videos do, and timestamps or --frame-rate replace it."""
    make_rig_file(tmp_path / "rig.json", {"a": SIZE, "b": SIZE})
    _images(tmp_path / "a", 3)
    make_video(tmp_path / "b.mp4", 3)
    with open_capture_folder(tmp_path) as capture:
        assert capture.sources[0].frame_rate == 30.0
        (line,) = capture.notices
        assert line.startswith("camera a: 30 Hz is assumed") and "--frame-rate" in line
    with open_capture_folder(tmp_path, frame_rate=25.0) as capture:
        assert capture.notices == ()
    rows = [f"{camera},{i},{40_000_000 * i}" for camera in "ab" for i in range(3)]
    (tmp_path / "timestamps.csv").write_text("camera,frame,stamp_ns\n" + "\n".join(rows) + "\n")
    with open_capture_folder(tmp_path) as capture:
        assert capture.notices == ()


def test_videos_without_a_camera(make_video, tmp_path):
    make_video(tmp_path / "cam01.mp4")
    says = "for the videos cam01; it has left; cameras without a video: left; names must be equal"
    with pytest.raises(CalibrationError, match=says):
        open_capture_folder(tmp_path, rig=_rig("left"))
    with pytest.raises(CalibrationError, match="no camera 'cam01'"):
        open_files(_rig("cam1"), {"cam01": tmp_path / "cam01.mp4"})


def test_two_files_of_one_camera(make_video, tmp_path):
    make_video(tmp_path / "cam1.mp4")
    _images(tmp_path / "cam1", 2)
    with pytest.raises(DataError, match="camera cam1 has both"):
        open_capture_folder(tmp_path, rig=_rig("cam1"))
    make_video(tmp_path / "cam1.avi", codec="MJPG")
    with pytest.raises(DataError, match=r"two videos of camera cam1: .*cam1\.avi and .*cam1\.mp4"):
        open_capture_folder(tmp_path, rig=_rig("cam1"))


def test_no_folder_and_no_rig(make_rig_file, tmp_path):
    with pytest.raises(DataError, match="does not exist"):
        open_capture_folder(tmp_path / "nowhere")
    (tmp_path / "skeletons.json").write_text("{}")
    with pytest.raises(DataError, match="has no rig"):
        open_capture_folder(tmp_path)
    make_rig_file(tmp_path / "my_cameras.json", {"cam1": SIZE})
    with pytest.raises(DataError, match=r"no video cam1\.mp4"):  # the rig was found
        open_capture_folder(tmp_path)


@pytest.mark.parametrize(
    ("rig_size", "advice"),
    [((48, 64), "exchanged"), ((128, 96), "'scale'"), ((72, 48), "'crop'"), ((640, 400), "use the rig")],
)
def test_an_image_size_that_differs_from_the_rigs_names_both(make_video, tmp_path, rig_size, advice):
    make_video(tmp_path / "cam1.mp4")
    camera = _camera(size=rig_size, centre=(0.5 * rig_size[0], 0.5 * rig_size[1]))
    with pytest.raises(CalibrationError, match=advice) as caught:
        open_capture_folder(tmp_path, rig=Rig((camera,)))
    assert "64x48" in str(caught.value) and f"{rig_size[0]}x{rig_size[1]}" in str(caught.value)


def test_width_and_height_that_only_the_rig_exchanges_are_told(make_video, tmp_path):
    make_video(tmp_path / "cam1.mp4")
    with open_capture_folder(tmp_path, rig=Rig((_camera(size=SIZE[::-1]),))) as capture:
        assert capture.rig.camera("cam1").image_size == SIZE
        (line,) = capture.notices
    assert "the rig states 48x64" in line and "taken as exchanged" in line


def test_videos_of_cameras_that_the_rig_leaves_out_are_left_alone(make_video, tmp_path):
    for name in ("cam1", "cam2"):
        make_video(tmp_path / f"{name}.mp4")
    rig = Rig((_camera(),), left_out={"cam2": "it has no pose"})
    with open_capture_folder(tmp_path, rig=rig) as capture:
        assert capture.rig.names == ("cam1",)


def test_scaling_moves_projections_as_resizing_moves_pixels(make_video, tmp_path):
    make_video(tmp_path / "cam1.mp4")
    big = _camera(size=(128, 96))
    capture = open_capture_folder(tmp_path, rig=Rig((big,)), size_policy="scale")
    points = np.random.default_rng(0).normal([0, 0, 4], 0.3, (20, 3))
    expected = (big.project(points)[0] + 0.5) / 2 - 0.5
    assert np.allclose(capture.rig.camera("cam1").project(points)[0], expected, atol=1e-12)
    assert capture.notices == ("camera cam1: calibrated at 128x96, images are 64x48: scale",)
    with pytest.raises(CalibrationError):
        fit_camera(_camera(size=(100, 96)), SIZE, "scale")


def test_letterboxing_moves_projections_as_resizing_and_padding_do():
    camera = _camera(size=(100, 60))
    fitted = fit_camera(camera, (50, 40), "letterbox")  # half the size, 5 rows above and below
    points = np.random.default_rng(0).normal([0, 0, 4], 0.3, (20, 3))
    expected = (camera.project(points)[0] + 0.5) / 2 - 0.5 + [0.0, 5.0]
    assert np.allclose(fitted.project(points)[0], expected, atol=1e-12) and fitted.image_size == (50, 40)


def test_cropping_keeps_pixels_where_they_are():
    camera = fit_camera(_camera(size=(1088, 1920)), (1080, 1920), "crop")
    assert camera.image_size == (1080, 1920)
    assert np.array_equal(camera.intrinsics.matrix, _camera().intrinsics.matrix)
    with pytest.raises(CalibrationError):
        fit_camera(_camera(size=(1088, 1920)), (1000, 1920), "crop")


def test_stamps_for_some_cameras_only(make_video, tmp_path):
    make_video(tmp_path / "a.mp4", 2)
    make_video(tmp_path / "b.mp4", 2)
    (tmp_path / "timestamps.csv").write_text("camera,frame,stamp_ns\na,0,1\na,1,2\n")
    with pytest.raises(DataError, match="none for camera b"):
        open_capture_folder(tmp_path, rig=_rig("a", "b"))


def _depths(folder, camera, count, size=(32, 24), kind=np.uint16):
    (folder / f"{camera}_depth").mkdir(parents=True)
    for i in range(count):
        image = np.full(size[::-1], 1500 + i if kind == np.uint16 else 9, kind)
        image[0, 0] = 0
        cv2.imwrite(str(folder / f"{camera}_depth" / f"{i}.png"), image)


def test_depth_maps_come_with_the_frames_of_their_camera(make_rig_file, tmp_path):
    make_rig_file(tmp_path / "rig.json", {"a": SIZE, "b": SIZE})
    for name in "ab":
        _images(tmp_path / name, 11)
    _depths(tmp_path, "b", 11)
    with open_capture_folder(tmp_path) as capture:
        assert capture.depth_cameras == ("b",)
        source = capture.sources[1]
        found = [(frame, source.depth_of(frame)) for frame in source]
    assert all((frame.stamp_ns, frame.frame_number) == (d.stamp_ns, d.frame_number) for frame, d in found)
    depths = [depth.depth for _, depth in found]
    assert [depth[5, 5] for depth in depths] == pytest.approx(1.5 + 1e-3 * np.arange(11))
    assert depths[0].shape == (24, 32) and depths[0][0, 0] == 0.0


@pytest.mark.parametrize(
    "count, size, kind, words",
    [
        (2, (32, 24), np.uint16, "has 2 depth maps for the 3 frames of camera a"),
        (3, (32, 24), np.uint8, "is uint8 .*expected a PNG of one channel, 16 bits"),
        (3, (24, 24), np.uint16, "has 24 x 24 pixels, its image 64 x 48"),
    ],
)
def test_depth_maps_that_do_not_fit_are_refused(make_rig_file, tmp_path, count, size, kind, words):
    make_rig_file(tmp_path / "rig.json", {"a": SIZE})
    _images(tmp_path / "a", 3)
    _depths(tmp_path, "a", count, size, kind)
    with pytest.raises(DataError, match=words), open_capture_folder(tmp_path) as capture:
        source = capture.sources[0]
        [source.depth_of(frame) for frame in source]


def test_occluders_beside_the_rig_belong_to_it(make_rig_file, tmp_path):
    make_rig_file(tmp_path / "rig.json", {"a": SIZE})
    _images(tmp_path / "a", 1)
    box = '{"size": [1, 1, 1], "centre": [0, 0, 1]}'
    (tmp_path / "occluders.json").write_text(f'{{"format": "panoptic-occluders-1", "boxes": [{box}]}}')
    with open_capture_folder(tmp_path) as capture:
        assert len(capture.rig.occluders.triangles) == 12
    with open_capture_folder(tmp_path, rig=_rig("a")) as capture:
        assert capture.rig.occluders is None


def test_a_turned_video_is_told_among_the_notices(film, make_rig_file, tmp_path):
    make_rig_file(tmp_path / "rig.json", {"cam00": (48, 64)})
    film(tmp_path / "cam00.mp4", [0, 3000], clockwise=90)
    with open_capture_folder(tmp_path) as capture:
        assert capture.notices == (
            "camera cam00: images are turned clockwise by 90 degrees, as marked in the file",
        )
