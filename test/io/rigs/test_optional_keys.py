"""What a rig may state besides its geometry, and which formats keep it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from panoptic_ros.cli.main import main
from panoptic_ros.domain import Camera, DepthSensor, Rig
from panoptic_ros.errors import CalibrationError, UsageError
from panoptic_ros.geometry import Intrinsics
from panoptic_ros.io.rigs import WRITABLE, read_rig, write_rig


def fisheye(camera: Camera) -> Camera:
    lens = Intrinsics(camera.intrinsics.matrix, [0.02, -0.01, 3e-3, -1e-3], "fisheye")
    return replace(camera, intrinsics=lens)


def stated(rig: Rig) -> Rig:
    """Everything that can be stated, by at least one camera or sensor."""
    a, b, c = rig.cameras
    root = np.random.default_rng(0).normal(0.0, 1e-3, (15, 15))
    a = replace(a, type="kinect", panel="3", clock="ltc A", line_delay_us=12.5, covariance=root @ root.T)
    inside = replace(b, name="k1", image_size=(512, 424), clock="k1 clock", covariance=root @ root.T)
    sensors = DepthSensor(inside, a.name, 0.00025), DepthSensor(replace(fisheye(c), name="lidar"))
    return replace(rig, cameras=(a, fisheye(b), replace(c, panel="left")), depth_sensors=sensors)


def assert_equal_cameras(one: Camera, other: Camera) -> None:
    for name in ("name", "image_size", "type", "panel", "clock", "line_delay_us"):
        assert getattr(one, name) == getattr(other, name), name
    assert one.intrinsics.lens == other.intrinsics.lens
    for name in ("matrix", "distortion"):
        assert np.array_equal(getattr(one.intrinsics, name), getattr(other.intrinsics, name))
    assert np.array_equal(one.cam_from_world.rotation, other.cam_from_world.rotation)
    assert (one.covariance is None) == (other.covariance is None)
    if one.covariance is not None:
        assert np.array_equal(one.covariance, other.covariance)


def test_rig_json_keeps_everything_to_the_bit(tmp_path: Path, rig: Rig) -> None:
    given = stated(rig)
    assert write_rig(tmp_path / "rig.json", given) == ()
    found = read_rig(tmp_path / "rig.json")
    for one, other in zip(given.cameras, found.cameras, strict=True):
        assert_equal_cameras(one, other)
    for mine, theirs in zip(given.depth_sensors, found.depth_sensors, strict=True):
        assert_equal_cameras(mine.camera, theirs.camera)
        assert (mine.colour_camera, mine.unit_m) == (theirs.colour_camera, theirs.unit_m)


def test_what_is_not_stated_is_not_written(tmp_path: Path, rig: Rig) -> None:
    write_rig(tmp_path / "rig.json", rig)
    document = json.loads((tmp_path / "rig.json").read_text())
    assert set(document) == {"format", "units", "cameras"}
    assert set(document["cameras"][0]) == {"name", "image_size", "K", "distortion", "R", "t"}


def test_a_depth_sensor_needs_no_distortion_and_counts_millimetres(tmp_path: Path, rig: Rig) -> None:
    write_rig(tmp_path / "rig.json", replace(rig, depth_sensors=stated(rig).depth_sensors[:1]))
    path = tmp_path / "rig.json"
    document = json.loads(path.read_text())
    for key in ("distortion", "unit_m", "colour_camera", "clock"):
        del document["depth_sensors"][0][key]
    path.write_text(json.dumps(document))
    (sensor,) = read_rig(path).depth_sensors
    assert sensor.unit_m == 0.001 and sensor.colour_camera == "" and sensor.camera.clock == ""
    assert not sensor.camera.intrinsics.distortion.any()


@pytest.mark.parametrize(
    ("place", "key", "value", "says"),
    [
        ("cameras", "type", 1.5, "camera cam00: 'type' is 1.5, expected text"),
        ("cameras", "lens", "omni", "camera cam00: the distortion model is 'omni'; models that are read"),
        ("cameras", "lens", "fisheye", "camera cam00: 5 distortion coefficients; a fisheye lens has only"),
        ("cameras", "line_delay_us", "fast", "camera cam00: 'line_delay_us' is 'fast', expected a number"),
        ("cameras", "line_delay_us", -1, "camera cam00: line_delay_us is -1.0, expected 0 or more"),
        ("cameras", "covariance", [[1.0]], "camera cam00: covariance has shape .*expected 15 x 15"),
        ("cameras", "covariance", [1.0], "camera cam00: 'covariance' is 1, expected n x n numbers"),
        ("depth_sensors", "unit_m", 0, "depth sensor k1: unit_m is 0.0, expected metres above 0"),
        ("depth_sensors", "unit_m", True, "depth sensor k1: 'unit_m' is True, expected a number"),
        ("depth_sensors", "colour_camera", "x", "sensor k1: the rig has no colour camera 'x'; it has cam00"),
        ("depth_sensors", "K", None, "depth sensor k1: 'K' is a single number"),
        ("depth_sensors", "name", "cam01", "2 cameras and depth sensors of the rig are called 'cam01'"),
    ],
)
def test_malformed_values(tmp_path: Path, rig: Rig, place: str, key: str, value: Any, says: str) -> None:
    write_rig(tmp_path / "rig.json", stated(rig))
    document = json.loads((tmp_path / "rig.json").read_text())
    document[place][0][key] = value
    (tmp_path / "rig.json").write_text(json.dumps(document))
    with pytest.raises(CalibrationError, match=says):
        read_rig(tmp_path / "rig.json")


def test_depth_sensors_are_a_list(tmp_path: Path, rig: Rig) -> None:
    write_rig(tmp_path / "rig.json", rig)
    document = json.loads((tmp_path / "rig.json").read_text())
    (tmp_path / "rig.json").write_text(json.dumps(document | {"depth_sensors": {"k1": 1}, "later": [1]}))
    with pytest.raises(CalibrationError, match="'depth_sensors' is .* expected a list"):
        read_rig(tmp_path / "rig.json")
    (tmp_path / "rig.json").write_text(json.dumps(document | {"depth_sensors": [3]}))
    with pytest.raises(CalibrationError, match="depth sensor number 0 is a int, expected a table"):
        read_rig(tmp_path / "rig.json")


def test_types_and_panels_choose_cameras_of_a_rig_json(tmp_path: Path, rig: Rig) -> None:
    write_rig(tmp_path / "rig.json", stated(rig))
    assert read_rig(tmp_path / "rig.json", types=["kinect"]).names == ("cam00",)
    by_panel = read_rig(tmp_path / "rig.json", panels=[3])
    assert by_panel.names == ("cam00",) and len(by_panel.depth_sensors) == 2
    with pytest.raises(UsageError, match="no camera is of types"):
        read_rig(tmp_path / "rig.json", types=["vga"])


def test_cmu_panoptic_keeps_type_and_panel(tmp_path: Path, rig: Rig) -> None:
    a, b, c = rig.cameras
    given = replace(rig, cameras=(replace(a, type="vga", panel="07"), replace(b, type="hd", panel="0"), c))
    assert write_rig(tmp_path / "c.json", given, "panoptic") == ()
    found = read_rig(tmp_path / "c.json")
    assert [(c.type, c.panel) for c in found.cameras] == [("vga", "07"), ("hd", "0"), ("", "")]
    assert json.loads((tmp_path / "c.json").read_text())["cameras"][1]["panel"] == 0
    assert read_rig(tmp_path / "c.json", types=["hd"], panels=[0]).names == ("cam01",)


@pytest.mark.parametrize("name", WRITABLE)
def test_a_fisheye_is_kept_or_refused(tmp_path: Path, rig: Rig, name: str) -> None:
    given = replace(rig, cameras=(rig.cameras[0], fisheye(rig.cameras[1]), rig.cameras[2]))
    if name in ("panoptic", "qca"):
        with pytest.raises(UsageError, match=r"has no fisheyes, and camera cam01 is one; write it as rig"):
            write_rig(tmp_path / "rig", given, name)
        assert not (tmp_path / "rig").exists()
        return
    assert write_rig(tmp_path / "rig", given, name) == ()
    found = read_rig(tmp_path / "rig")
    assert [camera.intrinsics.lens for camera in found.cameras] == ["brown", "fisheye", "brown"]
    for one, other in zip(given.cameras, found.cameras):
        assert np.array_equal(one.intrinsics.distortion, other.intrinsics.distortion)


def test_the_verb_says_what_a_format_leaves_out(
    tmp_path: Path, rig: Rig, capsys: pytest.CaptureFixture[str]
) -> None:
    write_rig(tmp_path / "rig.json", stated(rig))
    assert main(["rig", "convert", str(tmp_path / "rig.json"), str(tmp_path / "rig.toml")]) == 0
    told = capsys.readouterr().out
    assert "3 cameras; left out: type, panel, clock, line_delay_us, covariance, depth_sensors" in told
    assert main(["rig", "convert", str(tmp_path / "rig.json"), str(tmp_path / "rig.qca.txt")]) == 2
    assert "Qualisys .qca.txt has no fisheyes, and camera cam01 is one" in capsys.readouterr().err


MANY = [0.2, -0.1, 1e-3, 2e-3, 0.05, 0.1, -0.05, 0.02, 1e-3, 2e-3, 1e-3, 2e-3, 0.01, 0.02]


@pytest.mark.parametrize("count", [8, 12, 14])
@pytest.mark.parametrize("name", WRITABLE)
def test_a_lens_with_more_terms_is_kept_or_refused(tmp_path: Path, rig: Rig, name: str, count: int) -> None:
    lens = Intrinsics(rig.cameras[1].intrinsics.matrix, MANY[:count])
    given = replace(rig, cameras=(rig.cameras[0], replace(rig.cameras[1], intrinsics=lens), rig.cameras[2]))
    if name in ("panoptic", "qca"):
        with pytest.raises(UsageError, match=r"more than five terms of distortion, and camera cam01 is one"):
            write_rig(tmp_path / "rig", given, name)
        return
    assert write_rig(tmp_path / "rig", given, name) == ()
    found = read_rig(tmp_path / "rig")
    assert [len(camera.intrinsics.distortion) for camera in found.cameras] == [5, count, 5]
    assert np.array_equal(found.cameras[1].intrinsics.distortion, MANY[:count])


def test_covariances_follow_the_terms_of_the_lens(tmp_path: Path, rig: Rig) -> None:
    root = np.random.default_rng(0).normal(0.0, 1e-3, (18, 18))
    matrix = rig.cameras[0].intrinsics.matrix
    eight = replace(rig.cameras[0], intrinsics=Intrinsics(matrix, MANY[:8]), covariance=root @ root.T)
    padded = Intrinsics(matrix, [*MANY[:5], 0, 0, 0])
    five = replace(rig.cameras[1], intrinsics=padded, covariance=root @ root.T)
    assert np.array_equal(five.covariance, (root @ root.T)[:15, :15])
    write_rig(tmp_path / "rig.json", replace(rig, cameras=(eight, five)))
    found = read_rig(tmp_path / "rig.json")
    assert np.array_equal(found.cameras[0].covariance, eight.covariance)
    assert np.array_equal(found.cameras[1].covariance, five.covariance)


@pytest.mark.parametrize(
    ("numbers", "expected", "told"),
    [
        ([0.1, -0.2, 1e-3, 2e-3], [0.1, -0.2, 1e-3, 2e-3, 0.0], ()),
        ([*MANY[:5], 0, 0, 0], MANY[:5], ()),
        (
            [0.1, -0.2, 0.3],
            [0.1, -0.2, 0.0, 0.0, 0.3],
            ("camera cam01: the 3 distortion coefficients are taken as k1 k2 k3",),
        ),
    ],
)
@pytest.mark.parametrize("name", ["rig.json", "panoptic", "aniposelib", "caliscope"])
def test_the_numbers_of_a_lens_mean_the_same_in_all_formats(
    tmp_path: Path, rig: Rig, name: str, numbers: list[float], expected: list[float], told: tuple[str, ...]
) -> None:
    write_rig(tmp_path / "rig", rig, name)
    text = (tmp_path / "rig").read_text()
    if name == "panoptic":  # whose lists take several lines
        text = json.dumps(json.loads(text))
    old = json.dumps(rig.cameras[1].intrinsics.distortion.tolist())
    assert old in text
    (tmp_path / "rig").write_text(text.replace(old, json.dumps(numbers)))
    found = read_rig(tmp_path / "rig")
    assert found.camera("cam01").intrinsics.distortion.tolist() == expected
    assert tuple(line for line in found.notices if "assumed" not in line) == told


@pytest.mark.parametrize(
    ("model", "numbers", "lens", "expected", "told"),
    [
        ("rational_polynomial", MANY[:8], "brown", MANY[:8], ""),
        ("plumb_bob", [*MANY[:5], 0, 0, 0], "brown", MANY[:5], "has 5 coefficients, not 8; the others are 0"),
        ("plumb_bob", MANY[:8], "brown", MANY[:8], "the others are taken as those of OpenCV's model"),
        ("''", [], "brown", [0.0] * 5, ""),
        ("fisheye", MANY[:4], "fisheye", MANY[:4], ""),
        ("radtan", MANY[:4], "brown", [*MANY[:4], 0.0], ""),
    ],
)
def test_ros_folders_have_lenses_by_all_names(
    tmp_path: Path, rig: Rig, model: str, numbers: list[float], lens: str, expected: list[float], told: str
) -> None:
    write_rig(tmp_path / "rig", rig, "camera_info")
    path = tmp_path / "rig" / "cam01.yaml"
    document = yaml.safe_load(path.read_text())
    document["distortion_model"] = model.strip("'")
    document["distortion_coefficients"] = {"rows": 1, "cols": len(numbers), "data": numbers}
    path.write_text(yaml.safe_dump(document))
    found = read_rig(tmp_path / "rig")
    intrinsics = found.camera("cam01").intrinsics
    assert intrinsics.lens == lens and intrinsics.distortion.tolist() == expected
    assert told in "".join(found.notices) and len(found.notices) == bool(told)
