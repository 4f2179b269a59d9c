"""Cameras with fisheyes solve as well as those with Brown lenses, from files to the score."""
from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from panoptic_ros.cli.main import main
from panoptic_ros.domain import Camera, Rig
from panoptic_ros.geometry import Intrinsics
from panoptic_ros.io.files import write_json
from panoptic_ros.io.plain_formats import write_detections
from panoptic_ros.io.rigs import write_rig
from panoptic_ros.simulation import SKELETON, scene, simulate
from panoptic_ros.simulation.rigs import Ring

FRAMES = 40


@dataclass(frozen=True)
class Fisheyes:
    """A ring of cameras with other lenses. focal: relative to those of the ring."""

    ring: Ring
    focal: float

    def build(self, rng: np.random.Generator) -> Rig:
        rig = self.ring.build(rng)
        return replace(rig, cameras=tuple(self._fisheye(camera) for camera in rig.cameras))

    def _fisheye(self, camera: Camera) -> Camera:
        matrix = np.diag([self.focal, self.focal, 1.0]) @ camera.intrinsics.matrix
        matrix[:2, 2] = camera.intrinsics.matrix[:2, 2]
        return replace(camera, intrinsics=Intrinsics(matrix, [0.02, -0.01, 3e-3, -1e-3], "fisheye"))


def scores(folder: Path, rig: Ring | Fisheyes, capsys: pytest.CaptureFixture[str]) -> dict[str, float]:
    """What `panoptic solve` and `evaluate` print of a simulated take."""
    take = simulate(replace(scene("noisy-4p5v"), rig=rig), 0, FRAMES)
    folder.mkdir()
    write_rig(folder / "rig.json", take.rig)
    write_json(folder / "truth.json.gz", take.truth_document())
    write_detections(folder / "detections.json.gz", SKELETON.joint_names, take.detection_sets())
    files = {name: str(folder / f"{name}.json.gz") for name in ("truth", "detections", "result")}
    rig_file = str(folder / "rig.json")
    solve = ["--rig", rig_file, "--detections", files["detections"], "--out", files["result"]]
    assert main(["solve", *solve]) == 0
    capsys.readouterr()
    assert main(["evaluate", files["truth"], files["result"], "--json"]) == 0
    report: dict[str, float] = json.loads(capsys.readouterr().out)
    return report


def test_fisheyes_solve_as_well_as_brown_lenses(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    brown = scores(tmp_path / "brown", Ring(5), capsys)
    same = scores(tmp_path / "same", Fisheyes(Ring(5), 1.0), capsys)
    wide = scores(tmp_path / "wide", Fisheyes(Ring(5, radius=3.0), 0.3), capsys)  # 130 degrees across
    for found in (same, wide):
        assert found["joint_recall"] > 0.995 and found["joint_precision"] > 0.995
        assert found["result_persons"] == 4 * FRAMES
    assert same["mpjpe_mm"] < 1.15 * brown["mpjpe_mm"]
    assert wide["mpjpe_mm"] < 3.0 * brown["mpjpe_mm"]  # of pixels that are 2.4 times as large
