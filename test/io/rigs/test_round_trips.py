"""What is written is read back: to the bit for rig.json, to 1e-12 for the others."""

from __future__ import annotations

import shutil
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from panoptic_ros.domain import Camera, Rig
from panoptic_ros.errors import DataError, EnvironmentProblem, UsageError
from panoptic_ros.geometry import Intrinsics, Rigid
from panoptic_ros.io.rigs import WRITABLE, read_rig, write_rig

LETTERS = st.characters(codec="utf-8", categories=("L", "N", "P", "S"), exclude_characters="/")
NAMES = st.text(LETTERS, min_size=1, max_size=8).filter(
    lambda name: not name.startswith(".") and name != "poses"
)
SMALL = st.floats(-0.3, 0.3)


@st.composite
def cameras(draw: st.DrawFn, name: str) -> Camera:
    size = draw(st.tuples(st.integers(16, 8000), st.integers(16, 8000)))
    focal = st.floats(10.0, 9000.0)
    centre = st.floats(-100.0, 9000.0)
    matrix = [[draw(focal), draw(SMALL), draw(centre)], [0, draw(focal), draw(centre)], [0, 0, 1]]
    turn = Rotation.from_euler("xyz", draw(st.tuples(*[st.floats(-3.2, 3.2)] * 3))).as_matrix()
    place = draw(st.tuples(*[st.floats(-50.0, 50.0)] * 3))
    lens = draw(st.lists(SMALL, min_size=5, max_size=5))
    return Camera(name, size, Intrinsics(np.array(matrix), np.array(lens)), Rigid(turn, np.array(place)))


@st.composite
def rigs(draw: st.DrawFn) -> Rig:
    names = draw(st.lists(NAMES, min_size=1, max_size=4, unique=True))
    return Rig(tuple(draw(cameras(name)) for name in names))


def largest_difference(a: Rig, b: Rig) -> float:
    assert a.names == b.names
    worst = 0.0
    for one, other in zip(a.cameras, b.cameras):
        assert one.image_size == other.image_size
        for left, right in (
            (one.intrinsics.matrix, other.intrinsics.matrix),
            (one.intrinsics.distortion, other.intrinsics.distortion),
            (one.cam_from_world.rotation, other.cam_from_world.rotation),
            (one.cam_from_world.translation, other.cam_from_world.translation),
        ):
            scale = np.maximum(np.abs(left), 1.0)
            worst = max(worst, float((np.abs(left - right) / scale).max()))
    return worst


@pytest.mark.parametrize("name", WRITABLE)
@settings(max_examples=40, deadline=None)
@given(rig=rigs())
def test_every_format_gives_back_what_it_got(name: str, rig: Rig) -> None:
    folder = Path(tempfile.mkdtemp())
    try:
        write_rig(folder / "rig", rig, name)
        worst = largest_difference(rig, read_rig(folder / "rig"))
    finally:
        shutil.rmtree(folder)
    assert worst == 0.0 if name == "rig.json" else worst < 1e-12


@pytest.mark.parametrize(
    ("file", "begins"),
    [("a.json", '{"format": "panoptic-rig-1"'), ("a.qca.txt", "<calibration"), ("a.toml", "[cam_0]")],
)
def test_the_name_chooses_the_format(tmp_path: Path, rig: Rig, file: str, begins: str) -> None:
    write_rig(tmp_path / file, rig)
    assert (tmp_path / file).read_text().startswith(begins)
    assert read_rig(tmp_path / file).names == rig.names


def test_a_name_without_suffix_is_a_folder_of_camera_info(tmp_path: Path, rig: Rig) -> None:
    write_rig(tmp_path / "rig", rig)
    files = sorted(path.name for path in (tmp_path / "rig").iterdir())
    assert files == ["cam00.yaml", "cam01.yaml", "cam02.yaml", "poses.yaml"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["rig"]


def test_content_decides_not_the_name(tmp_path: Path, rig: Rig) -> None:
    for i, name in enumerate(n for n in WRITABLE if n != "camera_info"):
        write_rig(tmp_path / f"{i}.dat", rig, name)
        assert largest_difference(rig, read_rig(tmp_path / f"{i}.dat")) < 1e-12


def test_a_folder_without_frame_id_is_in_world(tmp_path: Path, rig: Rig) -> None:
    write_rig(tmp_path / "rig", replace(rig, frame_id="studio"), "camera_info")
    path = tmp_path / "rig" / "poses.yaml"
    path.write_text(path.read_text().replace("frame_id: studio\n", ""))
    assert read_rig(tmp_path / "rig").frame_id == "world"


def test_frame_id_survives(tmp_path: Path, rig: Rig) -> None:
    studio = Rig(rig.cameras, "studio")
    for name in ("rig.json", "camera_info"):
        write_rig(tmp_path / name, studio, name)
        assert read_rig(tmp_path / name).frame_id == "studio"


def test_rotation_rounded_to_six_digits_keeps_its_translation_in_qualisys(tmp_path: Path, rig: Rig) -> None:
    rounded = Rig(
        tuple(
            Camera(
                c.name,
                c.image_size,
                c.intrinsics,
                Rigid(np.round(c.cam_from_world.rotation, 6), c.cam_from_world.translation),
            )
            for c in rig.cameras
        )
    )
    write_rig(tmp_path / "a.qca.txt", rounded)
    assert largest_difference(rounded, read_rig(tmp_path / "a.qca.txt")) < 1e-12


def test_unknown_formats_and_places(tmp_path: Path, rig: Rig) -> None:
    with pytest.raises(UsageError, match=r"cannot write a rig as 'pack'"):
        write_rig(tmp_path / "a.json", rig, "pack")
    with pytest.raises(UsageError, match=r"cannot write a rig as '.bvh'"):
        write_rig(tmp_path / "a.bvh", rig)
    with pytest.raises(DataError, match=r"No such file"):
        read_rig(tmp_path / "missing.json")
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "x").touch()
    with pytest.raises(EnvironmentProblem, match=r"not empty"):
        write_rig(tmp_path / "full", rig)
    slashed = Rig((Camera("a/b", (640, 480), rig.cameras[0].intrinsics, rig.cameras[0].cam_from_world),))
    with pytest.raises(UsageError, match=r"cannot name a file"):
        write_rig(tmp_path / "folder", slashed)
