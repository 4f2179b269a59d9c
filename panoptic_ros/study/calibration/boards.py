"""The study `calibration`: cameras from simulated recordings of a board, beside the Cramer-Rao bound."""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from panoptic_ros.calibration.boards import Board
from panoptic_ros.calibration.bundle import PLAIN
from panoptic_ros.calibration.lens_start import LensModel
from panoptic_ros.calibration.projection import OFFSET, POSE
from panoptic_ros.calibration.quality import predicted_errors, space_of
from panoptic_ros.calibration.rig_start import CameraInput
from panoptic_ros.calibration.solve import CalibratedRig, calibrate_rig
from panoptic_ros.calibration.target_poses import intrinsics_of
from panoptic_ros.calibration.target_views import TargetView
from panoptic_ros.domain import Rig
from panoptic_ros.errors import CalibrationError
from panoptic_ros.geometry import ProjectionStack, Rigid, triangulate_robust
from panoptic_ros.geometry.rotations import vectors_of
from panoptic_ros.simulation.board_sessions import BoardScene, BoardSession, simulate_board
from panoptic_ros.stage import Progress
from panoptic_ros.study.options import add_seeds, known_names, words
from panoptic_ros.study.study import Case, Column, Result, Row, Study

Array = np.ndarray
BOARD = Board("checkerboard", 7, 10, 0.06)
FISHEYE = LensModel(fisheye=True, terms=4)


@dataclass(frozen=True)
class BoardCase:
    """Case of the study: a scene, and whether clocks are estimated."""

    scene: BoardScene
    clocks: bool = False


CASES = {
    "4x60": BoardCase(BoardScene(4, 60)),
    "4x200": BoardCase(BoardScene(4, 200)),
    "8x60": BoardCase(BoardScene(8, 60)),
    "8x200": BoardCase(BoardScene(8, 200)),
    "outliers": BoardCase(BoardScene(4, 100, outliers=0.01)),
    "fisheye": BoardCase(BoardScene(4, 100, lens="fisheye")),
    "webcams": BoardCase(BoardScene(4, 200, smooth=True, lag_s=0.06, jitter_s=0.015), clocks=True),
}


class Calibration(Study):
    """Errors of cameras, their covariance, and the time of the solution from corners."""

    columns = (
        Column("case", "case"),
        Column("failed", "failed", ".0%"),
        Column("rotation_rad", "rotation deg", ".3f", 180.0 / np.pi),
        Column("position_m", "position mm", ".2f", 1e3),
        Column("focal", "focal", ".3%"),
        Column("error_m", "error mm", ".2f", 1e3),
        Column("predicted_m", "bound mm", ".2f", 1e3),
        Column("ratio", "error / bound", ".2f"),
        Column("nees", "NEES / dof", ".2f"),
        Column("offset_s", "offset ms", ".2f", 1e3),
        Column("solve_s", "solve s", ".2f"),
    )
    over = ("case",)

    @classmethod
    def add_options(cls, parser: argparse.ArgumentParser) -> None:
        """See `Study`."""
        parser.add_argument(
            "--cases",
            type=words,
            default=list(CASES),
            metavar="NAME,NAME",
            help=f"cases; default {','.join(CASES)}",
        )
        add_seeds(parser, "0:10")

    def cases(self) -> list[Case]:
        """See `Study`."""
        return [
            Case(f"{name}, seed {seed}", (name, seed), _cost(CASES[name].scene))
            for name in known_names(self.options.cases, CASES, "case")
            for seed in self.options.seeds
        ]

    def measure(self, case: Case, progress: Progress) -> Iterator[Row]:
        """See `Study`."""
        name, seed = case.request
        chosen = CASES[name]
        session = simulate_board(chosen.scene, BOARD.points, seed)
        model = FISHEYE if chosen.scene.lens == "fisheye" else LensModel()
        inputs = [CameraInput(camera.name, camera.image_size, model) for camera in session.rig.cameras]
        views = [TargetView(*view) for view in session.views]
        begin = time.perf_counter()
        try:
            found = calibrate_rig(inputs, views, BOARD.points, clocks=chosen.clocks)
        except CalibrationError:
            yield {"case": name, "seed": seed, "failed": 1.0}
            return
        yield {
            "case": name,
            "seed": seed,
            "failed": 0.0,
            "solve_s": time.perf_counter() - begin,
            **errors_of(found, session),
        }

    def head(self, result: Result) -> str:
        """See `Study`."""
        return (
            "Simulated board of 7 x 10 corners of 60 mm, noise 0.3 px, all intrinsics unknown.\n"
            "Cases: cameras x instants. "
            "Errors of rotation, position and focal length: medians over cameras.\n"
            "Error: of points in the space of the board, triangulated from exact pixels, after rigid "
            "alignment.\nBound: the same from the Cramer-Rao bound."
        )


def _cost(scene: BoardScene) -> float:
    return float(scene.instants * scene.cameras)


def errors_of(found: CalibratedRig, session: BoardSession) -> Row:
    """Return the errors of a calibration against the truth, relative to the first camera."""
    states, truth = found.state.cameras, session.rig
    reference = truth.cameras[0].cam_from_world.inverse()
    true = [camera.cam_from_world.compose(reference) for camera in truth.cameras]
    turns = np.stack([t.rotation @ r.T for t, r in zip(true, states.rotations)])
    moves = np.stack([t.translation for t in true]) - states.translations
    apart = np.concatenate([vectors_of(np.ascontiguousarray(turns)), moves], axis=1)
    nees = []
    for c in range(1, len(truth)):
        rows = found.index[c, :POSE]
        nees.append(apart[c] @ np.linalg.solve(found.covariance[np.ix_(rows, rows)], apart[c]) / POSE)
    points = space_of(found)
    error = np.sqrt((triangulation_errors(found, truth, reference, points) ** 2).mean())
    predicted = np.sqrt((predicted_errors(found, points) ** 2).mean())
    focal = [camera.intrinsics.matrix[0, 0] for camera in truth.cameras]
    free = found.index[:, OFFSET] >= 0
    late = (states.offsets - states.offsets[0]) - (session.offsets - session.offsets[0])
    return {
        "rotation_rad": float(np.median(np.linalg.norm(apart[1:, :3], axis=1))),
        "position_m": float(np.median(np.linalg.norm(apart[1:, 3:], axis=1))),
        "focal": float(np.median(np.abs(states.lenses[:, 0] / focal - 1.0))),
        "error_m": float(error),
        "predicted_m": float(predicted),
        "ratio": float(error / predicted),
        "nees": float(np.mean(nees)),
        "offset_s": float(np.sqrt((late[free] ** 2).mean())) if free.any() else np.nan,
    }


def triangulation_errors(found: CalibratedRig, truth: Rig, world_from_first: Rigid, points: Array) -> Array:
    """Return the errors (N,) m of points (N, 3) m, of the frame of the first camera, after rigid alignment.

    True cameras project them, the found cameras triangulate the pixels.
    """
    pixels = []
    for camera in truth.cameras:
        own, _ = camera.intrinsics.project(camera.cam_from_world.apply(world_from_first.apply(points)))
        with np.errstate(invalid="ignore"):
            inside = np.all((own > 0.0) & (own < np.array(camera.image_size)), axis=1)
        pixels.append(np.where(inside[:, None], own, np.nan))
    triangulated = exact_points(found, np.stack(pixels, axis=1))
    good = np.isfinite(triangulated).all(axis=1)
    a, b = triangulated[good], points[good]
    u, _, v = np.linalg.svd((a - a.mean(0)).T @ (b - b.mean(0)))
    turn = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ v))]) @ v
    errors: Array = np.linalg.norm((a - a.mean(0)) @ turn - (b - b.mean(0)), axis=1)
    return errors


def exact_points(found: CalibratedRig, pixels: Array) -> Array:
    """Return points (N, 3) m of least squared residual of pixels (N, C, 2), NaN where a camera sees none.

    Points are in the frame of the first camera, and NaN with fewer than two views.
    """
    states = found.state.cameras
    plane = np.stack(
        [
            intrinsics_of(lens, bool(fisheye)).undistort(pixels[:, c])
            for c, (lens, fisheye) in enumerate(zip(states.lenses, states.fisheye))
        ],
        axis=1,
    )
    stack = ProjectionStack(states.rotations, states.translations, states.lenses[:, 0])
    result = triangulate_robust(stack, plane, np.ones(plane.shape[:2]), cauchy=PLAIN, gate=PLAIN)
    return result.points
