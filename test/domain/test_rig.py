"""Cameras, depth sensors and rigs: what they refuse and what they keep."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from panoptic_ros.domain import Camera, DepthSensor, Rig
from panoptic_ros.errors import CalibrationError
from panoptic_ros.geometry import Intrinsics, Rigid

MATRIX = np.array([[500.0, 0.0, 320.0], [0.0, 500.0, 240.0], [0.0, 0.0, 1.0]])
BROWN, FISHEYE = Intrinsics(MATRIX, np.zeros(5)), Intrinsics(MATRIX, np.zeros(4), "fisheye")


def camera(name: str = "a", intrinsics: Intrinsics = BROWN, **more: object) -> Camera:
    return Camera(name, (640, 480), intrinsics, Rigid.identity(), **more)  # type: ignore[arg-type]


def spread(size: int) -> np.ndarray:
    root = np.random.default_rng(size).normal(0.0, 1e-3, (size, size))
    return root @ root.T


def test_what_is_not_stated_is_empty() -> None:
    plain = camera()
    assert (plain.type, plain.panel, plain.clock, plain.line_delay_us) == ("", "", "", 0.0)
    assert plain.covariance is None


@pytest.mark.parametrize(("lens", "size"), [(BROWN, 15), (FISHEYE, 14)])
def test_a_covariance_is_a_read_only_copy_of_the_size_that_the_lens_asks_for(
    lens: Intrinsics, size: int
) -> None:
    given = spread(size)
    kept = camera(intrinsics=lens, covariance=given).covariance
    assert kept is not None and np.array_equal(kept, given)
    given[0, 0] = 1.0
    assert kept[0, 0] != 1.0 and not kept.flags.writeable
    with pytest.raises(CalibrationError, match=f"camera a: covariance .* expected {size} x {size}"):
        camera(intrinsics=lens, covariance=spread(size - 1))


@pytest.mark.parametrize(
    ("row", "column", "value", "told"),
    [(2, 2, np.nan, "finite"), (0, 1, 1.0, "symmetric"), (3, 3, -1e-6, "negative")],
)
def test_an_impossible_covariance_is_refused(row: int, column: int, value: float, told: str) -> None:
    covariance = np.diag(np.full(15, 1e-6))
    covariance[row, column] = value
    with pytest.raises(CalibrationError, match=f"camera a: covariance .*{told}"):
        camera(covariance=covariance)


@pytest.mark.parametrize("delay", [-1.0, float("nan"), float("inf")])
def test_an_impossible_line_delay_is_refused(delay: float) -> None:
    with pytest.raises(CalibrationError, match="camera a: line_delay_us"):
        camera(line_delay_us=delay)


@pytest.mark.parametrize("unit", [0.0, -0.001, float("nan"), float("inf")])
def test_an_impossible_unit_of_depth_is_refused(unit: float) -> None:
    with pytest.raises(CalibrationError, match="depth sensor d: unit_m"):
        DepthSensor(camera("d"), unit_m=unit)


def test_names_of_sensors_differ_from_each_other_and_from_those_of_cameras() -> None:
    with pytest.raises(CalibrationError, match="2 cameras and depth sensors of the rig are called 'a'"):
        Rig((camera("a"),), depth_sensors=(DepthSensor(camera("a")),))
    with pytest.raises(CalibrationError, match="2 cameras and depth sensors of the rig are called 'd'"):
        Rig((camera("a"),), depth_sensors=(DepthSensor(camera("d")), DepthSensor(camera("d"))))
    with pytest.raises(CalibrationError, match="2 cameras of the rig are called 'a'"):
        Rig((camera("a"), camera("a")))


def test_a_colour_camera_is_another_camera_of_the_rig() -> None:
    with pytest.raises(CalibrationError, match="sensor d: the rig has no colour camera 'c'; it has a, b"):
        Rig((camera("a"), camera("b")), depth_sensors=(DepthSensor(camera("d"), "c"),))
    with pytest.raises(CalibrationError, match="its own colour camera"):
        DepthSensor(camera("d"), "d")


def test_a_part_of_a_rig_keeps_the_sensors() -> None:
    d, e, f = DepthSensor(camera("d"), "a", 0.00025), DepthSensor(camera("e"), "b"), DepthSensor(camera("f"))
    rig = Rig((camera("a"), camera("b")), "studio", depth_sensors=(d, e, f))
    part = rig.subset(["b"])
    assert part.names == ("b",) and part.frame_id == "studio"
    assert [(s.name, s.colour_camera) for s in part.depth_sensors] == [("d", ""), ("e", "b"), ("f", "")]
    assert part.depth_sensor("d").unit_m == 0.00025
    with pytest.raises(CalibrationError, match="no depth sensor 'x'; it has d, e, f"):
        part.depth_sensor("x")
    with pytest.raises(CalibrationError, match="no depth sensor 'd'; it has none"):
        replace(rig, depth_sensors=()).depth_sensor("d")
