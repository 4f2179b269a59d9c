"""Units and up directions that a calibration does not state are assumed, and stated in one line each."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from panoptic_ros.evaluation.rig_up import assumed_up
from panoptic_ros.io.rigs import read_rig, write_rig
from panoptic_ros.study.faults import samples

UNIT, UP = "lengths are assumed to be metres", "+z is assumed to be up"


def told(path: Path, unit: str | None = None) -> list[str]:
    """What is assumed of a rig, as `solve` prints it."""
    rig = read_rig(path, unit=unit)
    lines = [*rig.notices, *assumed_up(rig)]
    assert all("`panoptic rig check RIG --detections FILE` finds it from people" in line for line in lines)
    return [line.partition(",")[0] for line in lines]


@pytest.mark.parametrize(
    ("form", "name", "unit", "assumed"),
    [
        ("caliscope", "rig.toml", None, [UNIT]),
        ("caliscope", "rig.toml", "m", []),
        ("aniposelib", "rig.toml", None, []),
        ("rig.json", "rig.json", None, []),
        ("qca", "rig.qca.txt", None, []),
    ],
)
def test_what_our_own_files_leave_out(
    tmp_path: Path, form: str, name: str, unit: str | None, assumed: list[str]
) -> None:
    write_rig(tmp_path / name, samples.rig(), form)
    assert told(tmp_path / name, unit) == assumed


@pytest.mark.parametrize(
    ("left_out", "assumed"),
    [("unit", [UNIT]), ("up", [UP]), ("unit up", [UNIT, UP]), ("[metadata]", [UNIT, UP])],
)
def test_metadata_that_other_programs_do_not_write(tmp_path: Path, left_out: str, assumed: list[str]) -> None:
    write_rig(tmp_path / "rig.toml", samples.rig(), "aniposelib")
    text = (tmp_path / "rig.toml").read_text()
    if left_out == "[metadata]":
        text = text.partition("[metadata]")[0]
    for key in left_out.split():
        text = "\n".join(line for line in text.splitlines() if not line.startswith(f"{key} = "))
    (tmp_path / "rig.toml").write_text(text)
    assert told(tmp_path / "rig.toml") == assumed


def test_a_rig_of_unknown_up() -> None:
    assert len(assumed_up(replace(samples.rig(), up=None))) == 1 and not assumed_up(samples.rig())
