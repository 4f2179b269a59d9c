"""Maps of depth sensors that are not cameras."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from panoptic_ros.capture import DepthSource, open_capture_folder, open_depth_sensors
from panoptic_ros.domain import Camera, DepthSensor, Rig
from panoptic_ros.errors import DataError
from panoptic_ros.geometry import Intrinsics, Rigid
from panoptic_ros.io.rigs import write_rig

SIZE = (32, 24)


def camera(name: str, size: tuple[int, int] = SIZE) -> Camera:
    matrix = np.array([[50.0, 0.0, 15.0], [0.0, 55.0, 12.0], [0.0, 0.0, 1.0]])
    return Camera(name, size, Intrinsics(matrix, np.zeros(5)), Rigid.identity())


def rig() -> Rig:
    near = DepthSensor(camera("near"), "a", 0.00025)
    return Rig((camera("a"),), depth_sensors=(near, DepthSensor(camera("far"))))


def maps(folder: Path, sensor: str, count: int, size: tuple[int, int] = SIZE) -> None:
    place = folder / f"{sensor}_depth"
    place.mkdir(parents=True)
    for i in range(count):
        image = np.full(size[::-1], 4000 + i, np.uint16)
        image[0, 0] = 0
        cv2.imwrite(str(place / f"{i}.png"), image)


def images(folder: Path, name: str, count: int) -> None:
    (folder / name).mkdir(parents=True)
    for i in range(count):
        cv2.imwrite(str(folder / name / f"{i}.png"), np.full((*SIZE[::-1], 3), i, np.uint8))


def test_maps_are_in_the_unit_of_their_sensor_and_in_natural_order(tmp_path: Path) -> None:
    maps(tmp_path, "near", 11)
    maps(tmp_path, "far", 2)
    near, far = open_depth_sensors(tmp_path, rig(), start_ns=7, frame_rate=10.0)
    frames = list(near)
    assert [frame.frame_number for frame in frames] == list(range(11))
    assert [frame.stamp_ns for frame in frames] == [7 + 100_000_000 * i for i in range(11)]
    assert [frame.depth[5, 5] for frame in frames] == pytest.approx(1.0 + 0.00025 * np.arange(11))
    assert frames[0].camera == "near" and frames[0].depth[0, 0] == 0.0 and frames[0].image_size == SIZE
    assert [frame.depth[5, 5] for frame in far] == pytest.approx([4.0, 4.001])
    assert len(list(near)) == 11  # it starts anew


def test_a_capture_folder_has_the_sensors_with_stamps_of_their_own(tmp_path: Path) -> None:
    write_rig(tmp_path / "rig.json", rig())
    images(tmp_path, "a", 2)
    maps(tmp_path, "near", 3)
    rows = ["a,0,100", "a,1,200", "near,0,90", "near,1,130", "near,2,170"]
    (tmp_path / "timestamps.csv").write_text("\n".join(["camera,frame,stamp_ns", *rows]))
    with open_capture_folder(tmp_path) as capture:
        (source,) = capture.depth_sensors
        assert [frame.stamp_ns for frame in source] == [90, 130, 170]
        assert capture.depth_cameras == () and capture.frame_count == 2
        assert capture.notices == ("depth sensor far of the rig has no maps",)
        assert [sensor.name for sensor in capture.rig.depth_sensors] == ["near", "far"]


@pytest.mark.parametrize(
    ("rows", "told"),
    [
        (["a,0,100"], "stamps for a but none for depth sensor near"),
        (["a,0,100", "near,0,5"], "there are 2 depth maps of sensor near but 1 stamps"),
        (["a,0,100", "near,0,5", "near,1,5"], "sensor near: the stamp of frame 1"),
    ],
)
def test_stamps_that_do_not_fit_are_refused(tmp_path: Path, rows: list[str], told: str) -> None:
    write_rig(tmp_path / "rig.json", rig())
    images(tmp_path, "a", 1)
    maps(tmp_path, "near", 2)
    (tmp_path / "timestamps.csv").write_text("\n".join(["camera,frame,stamp_ns", *rows]))
    with pytest.raises(DataError, match=told):
        open_capture_folder(tmp_path)


def test_maps_have_the_size_that_the_rig_says(tmp_path: Path) -> None:
    maps(tmp_path, "near", 1, (30, 24))
    (source,) = open_depth_sensors(tmp_path, rig())
    with pytest.raises(DataError, match="30 x 24 pixels, but the rig states 32 x 24 for sensor near"):
        list(source)


def test_depth_registered_to_a_camera_stays_with_its_images(tmp_path: Path) -> None:
    write_rig(tmp_path / "rig.json", replace(rig(), depth_sensors=rig().depth_sensors[1:]))
    images(tmp_path, "a", 2)
    maps(tmp_path, "a", 2)
    maps(tmp_path, "far", 1)
    with open_capture_folder(tmp_path) as capture:
        assert capture.depth_cameras == ("a",)
        (source,) = capture.sources
        assert isinstance(source, DepthSource)
        found = [source.depth_of(frame).depth[5, 5] for frame in source]
        assert found == pytest.approx([4.0, 4.001])
        assert [sensor.camera for sensor in capture.depth_sensors] == ["far"]
