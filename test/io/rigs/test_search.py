"""Finding the rig of a capture folder."""

from __future__ import annotations

from pathlib import Path

import pytest

from panoptic_ros.domain import Rig
from panoptic_ros.errors import DataError, UsageError
from panoptic_ros.io.rigs import find_rig, write_rig


def test_rig_json_comes_first(tmp_path: Path, rig: Rig) -> None:
    write_rig(tmp_path / "other.toml", rig)
    write_rig(tmp_path / "rig.json", rig)
    assert find_rig(tmp_path) == tmp_path / "rig.json"


@pytest.mark.parametrize(
    "place", ["Calib.qca.txt", "camera_array.toml", "calibration/Calib.qca.txt", "calibration"]
)
def test_any_single_rig_is_found(tmp_path: Path, rig: Rig, place: str) -> None:
    (tmp_path / "report.json").write_text('{"people": 3}')
    (tmp_path / "broken.json").write_text("{")
    write_rig(tmp_path / place, rig)
    assert find_rig(tmp_path) == tmp_path / place


def test_none_and_several(tmp_path: Path, rig: Rig) -> None:
    with pytest.raises(DataError, match="has no rig"):
        find_rig(tmp_path)
    with pytest.raises(DataError, match="is not a folder"):
        find_rig(tmp_path / "missing")
    write_rig(tmp_path / "a.toml", rig)
    write_rig(tmp_path / "b.qca.txt", rig)
    with pytest.raises(UsageError, match=r"several rigs: a\.toml, b\.qca\.txt"):
        find_rig(tmp_path)


def test_a_folder_without_a_rig_names_one_that_is_broken_or_of_another_program(tmp_path: Path) -> None:
    (tmp_path / "rig.toml").write_text("[cam_0]\nmatrix = [[1.0\n")
    with pytest.raises(DataError, match=r"has no rig; .*\. rig\.toml: the file is broken: .*line"):
        find_rig(tmp_path)
    (tmp_path / "rig.toml").unlink()
    (tmp_path / "intri.yml").write_text("%YAML:1.0\n---\nK_01: !!opencv-matrix\n  rows: 3\n")
    with pytest.raises(DataError, match=r"intri\.yml is a calibration of EasyMocap"):
        find_rig(tmp_path)
