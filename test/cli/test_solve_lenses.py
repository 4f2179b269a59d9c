"""Fisheyes and lenses with more terms solve as well as Brown lenses, from files to the score."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from panoptic_ros.cli.main import main
from panoptic_ros.domain import Camera, Rig
from panoptic_ros.geometry import Intrinsics, Lens
from panoptic_ros.io.files import write_json
from panoptic_ros.io.plain_formats import write_detections
from panoptic_ros.io.rigs import write_rig
from panoptic_ros.simulation import SKELETON, scene, simulate
from panoptic_ros.simulation.rigs import Ring

FRAMES = 20
KINECT = (0.66, -2.7, 6e-4, -2e-4, 1.55, 0.54, -2.5, 1.48)  # as an Azure Kinect's colour camera


@dataclass(frozen=True)
class Others:
    """A ring of cameras with other lenses.

    Args:
        focal: relative to those of the ring. terms: of fisheyes, or more than five of a Brown lens.
    """

    ring: Ring
    focal: float
    terms: tuple[float, ...] = (0.02, -0.01, 3e-3, -1e-3)

    def build(self, rng: np.random.Generator) -> Rig:
        rig = self.ring.build(rng)
        return replace(rig, cameras=tuple(self._other(camera) for camera in rig.cameras))

    def _other(self, camera: Camera) -> Camera:
        matrix = np.diag([self.focal, self.focal, 1.0]) @ camera.intrinsics.matrix
        matrix[:2, 2] = camera.intrinsics.matrix[:2, 2]
        kind: Lens = "fisheye" if len(self.terms) == 4 else "brown"
        return replace(camera, intrinsics=Intrinsics(matrix, np.array(self.terms), kind))


def scores(folder: Path, rig: Ring | Others, capsys: pytest.CaptureFixture[str]) -> dict[str, float]:
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


def test_other_lenses_solve_as_well_as_brown_ones(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    brown = scores(tmp_path / "brown", Ring(5), capsys)
    same = scores(tmp_path / "same", Others(Ring(5), 1.0), capsys)
    wide = scores(tmp_path / "wide", Others(Ring(5, radius=3.0), 0.3), capsys)  # 130 degrees across
    many = scores(tmp_path / "many", Others(Ring(5), 1.0, KINECT), capsys)
    for found in (same, wide, many):
        assert found["joint_recall"] > 0.995 and found["joint_precision"] > 0.995
        assert found["result_persons"] == 4 * FRAMES
    assert max(same["mpjpe_mm"], many["mpjpe_mm"]) < 1.15 * brown["mpjpe_mm"]
    assert wide["mpjpe_mm"] < 3.0 * brown["mpjpe_mm"]  # of pixels that are 2.4 times as large
