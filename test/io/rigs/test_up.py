"""The up direction in files of rigs."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from panoptic_ros.domain import Camera, Rig
from panoptic_ros.domain.upright import Z_UP
from panoptic_ros.errors import CalibrationError
from panoptic_ros.geometry import Intrinsics, Rigid
from panoptic_ros.io.rigs import read_rig, write_rig

Z_IS_UP = np.eye(3)
Y_DOWN = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])  # of a world with z up
UPS = [Z_UP, (0.0, -1.0, 0.0), (0.6, 0.0, 0.8), (1.0, 2.0, -3.0), None]


@pytest.mark.parametrize("up", UPS)
@pytest.mark.parametrize("file", ["rig.json", "cameras.toml"])
def test_up_is_kept_to_the_bit(tmp_path: Path, rig: Rig, up, file: str) -> None:
    given = replace(rig, up=up)
    assert write_rig(tmp_path / file, given) == ()
    assert read_rig(tmp_path / file).up == given.up


def test_formats_with_z_up_leave_another_direction_out(tmp_path: Path, rig: Rig) -> None:
    assert write_rig(tmp_path / "a.qca.txt", replace(rig, up=(0.0, -1.0, 0.0))) == ("up",)
    assert read_rig(tmp_path / "a.qca.txt").up == Z_UP


@pytest.mark.parametrize("value", [[0, 0, 0], [0, 1], "z", [0, 0, float("nan")]])
def test_an_up_that_is_no_direction_is_refused(tmp_path: Path, rig: Rig, value: object) -> None:
    write_rig(tmp_path / "rig.json", rig)
    document = json.loads((tmp_path / "rig.json").read_text())
    (tmp_path / "rig.json").write_text(json.dumps(document | {"up": value}))
    with pytest.raises(CalibrationError, match="up"):
        read_rig(tmp_path / "rig.json")


def ring(*quarters: int, world: np.ndarray = Z_IS_UP) -> Rig:
    """Level cameras round the middle, turned clockwise by quarter turns, in a world that is world @ z up."""
    lens = Intrinsics(np.array([[500.0, 0.0, 320.0], [0.0, 500.0, 240.0], [0.0, 0.0, 1.0]]), np.zeros(5))
    cameras = []
    for i, turns in enumerate(quarters):
        a, q = 2.0 * np.pi * i / len(quarters), np.round(np.exp(0.5j * np.pi * turns))
        forward, right = np.array([np.cos(a), np.sin(a), -0.2]), np.array([np.sin(a), -np.cos(a), 0.0])
        forward /= np.linalg.norm(forward)
        level = np.stack([right, np.cross(forward, right), forward])
        clockwise = np.array([[q.real, q.imag, 0.0], [-q.imag, q.real, 0.0], [0.0, 0.0, 1.0]])
        pose = clockwise @ level @ world.T
        cameras.append(Camera(f"cam_{i}", (640, 480), lens, Rigid(pose, [0.0, 0.0, 3.0])))
    return Rig(tuple(cameras))


@pytest.mark.parametrize("quarters", [(0, 0, 0, 0), (1, 1, 1, 1), (0, 3, 0, 0), (2, 2, 2, 2), (0, 1, 2, 3)])
@pytest.mark.parametrize("world", [Z_IS_UP, Y_DOWN, Y_DOWN @ Y_DOWN])
def test_rotation_counts_of_caliscope_tell_up(
    tmp_path: Path, quarters: tuple[int, ...], world: np.ndarray
) -> None:
    path, up = tmp_path / "rig.toml", world @ Z_UP
    assert write_rig(path, replace(ring(*quarters, world=world), up=tuple(up)), "caliscope") == ()
    text = path.read_text()
    counts = [int(line.split("=")[1]) for line in text.splitlines() if line.startswith("rotation_count")]
    assert counts == list(quarters)
    for same in (text, text.replace("rotation_count = 3", "rotation_count = -1")):
        path.write_text(same)
        np.testing.assert_allclose(read_rig(path).up, up, atol=1e-9)


def test_without_rotation_counts_up_is_not_known(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    write_rig(path, ring(0, 0, 0, 0), "caliscope")
    lines = path.read_text().splitlines()
    path.write_text("\n".join(line for line in lines if not line.startswith("rotation_count")))
    assert read_rig(path).up is None
    path.write_text(path.read_text().replace("cam_id = 0", 'rotation_count = "left"'))
    with pytest.raises(CalibrationError, match="rotation_count.*'left'.*whole number of quarter turns"):
        read_rig(path)
