"""The study `calibration`: cameras from simulated recordings of a board, beside the Cramer-Rao bound."""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from panoptic_ros.calibration.boards import Board
from panoptic_ros.calibration.lens_start import LensModel
from panoptic_ros.calibration.projection import OFFSET, POSE
from panoptic_ros.calibration.quality import predicted_errors, space_of
from panoptic_ros.calibration.rig_start import CameraInput
from panoptic_ros.calibration.solve import CalibratedRig, calibrate_from, calibrate_rig
from panoptic_ros.calibration.target_views import TargetView
from panoptic_ros.calibration.wand_start import start_wand
from panoptic_ros.calibration.wands import Wand, parse_wand
from panoptic_ros.calibration.world import rig_in_world
from panoptic_ros.domain import Rig
from panoptic_ros.errors import CalibrationError
from panoptic_ros.geometry import Rigid
from panoptic_ros.geometry.rotations import vectors_of
from panoptic_ros.simulation.board_sessions import BoardScene, BoardSession, simulate_board
from panoptic_ros.stage import Progress
from panoptic_ros.study.calibration.alignment import triangulated
from panoptic_ros.study.calibration.peers import OWN, Problem, add_peers, attempts, with_known_lens
from panoptic_ros.study.options import add_cases, add_seeds, known_names
from panoptic_ros.study.study import Case, Column, Result, Row, Study

Array = np.ndarray
BOARD = Board("checkerboard", 7, 10, 0.06)
FISHEYE = LensModel(fisheye=True, terms=4)
CALIBRATED = (5e-3, 3.0, 0.02)  # the same, of lenses that were calibrated before the wand
EXACT = (1e-6, 1e-3, 1e-6)  # relative focal length, px, distortion: deviations of lenses taken as known
ERRORS = (
    Column("rotation_rad", "rotation deg", ".3f", 180.0 / np.pi),
    Column("position_m", "position mm", ".2f", 1e3),
    Column("focal", "focal", ".3%"),
    Column("error_m", "error mm", ".2f", 1e3),
    Column("predicted_m", "bound mm", ".2f", 1e3),
    Column("ratio", "error / bound", ".2f"),
    Column("nees", "NEES / dof", ".2f"),
)


@dataclass(frozen=True)
class BoardCase:
    """Case of the study: a scene, whether clocks are estimated, and the wand that replaces the board."""

    scene: BoardScene
    clocks: bool = False
    wand: Wand | None = None


CASES = {
    "4x60": BoardCase(BoardScene(4, 60)),
    "4x200": BoardCase(BoardScene(4, 200)),
    "8x60": BoardCase(BoardScene(8, 60)),
    "8x200": BoardCase(BoardScene(8, 200)),
    "outliers": BoardCase(BoardScene(4, 100, outliers=0.01)),
    "fisheye": BoardCase(BoardScene(4, 100, lens="fisheye")),
    "wand-2": BoardCase(BoardScene(4, 500, all_round=True), wand=parse_wand("wand:500mm")),
    "wand-3": BoardCase(BoardScene(8, 500, all_round=True), wand=parse_wand("wand:0/150/500mm")),
    "webcams": BoardCase(BoardScene(4, 200, smooth=True, lag_s=0.06, jitter_s=0.015), clocks=True),
}
LARGE = {"31x300": BoardCase(BoardScene(31, 300))}
ALL = {**CASES, **LARGE}


class Calibration(Study):
    """Errors of cameras, their covariance, and the time of the solution from corners."""

    columns = (
        Column("case", "case"),
        Column("program", "program"),
        Column("intrinsics", "intrinsics"),
        Column("failed", "failed", ".0%"),
        *ERRORS,
        Column("offset_s", "offset ms", ".2f", 1e3),
        Column("solve_s", "solve s", ".2f"),
    )
    over = ("case", "program", "intrinsics")

    @classmethod
    def add_options(cls, parser: argparse.ArgumentParser) -> None:
        """See `Study`."""
        add_cases(parser, CASES, LARGE)
        add_seeds(parser, "0:10")
        add_peers(parser)

    def cases(self) -> list[Case]:
        """See `Study`."""
        return [
            Case(f"{name}, seed {seed}", (name, seed), _cost(ALL[name].scene))
            for name in known_names(self.options.cases, ALL, "case")
            for seed in self.options.seeds
        ]

    def measure(self, case: Case, progress: Progress) -> Iterator[Row]:
        """See `Study`."""
        name, seed = case.request
        chosen = ALL[name]
        if chosen.wand is not None:
            row = self._wand_row(chosen, chosen.wand, seed)
            yield {**row, "case": name, "seed": seed, "intrinsics": "prior"}
            return
        session = simulate_board(chosen.scene, BOARD.points, seed)
        model = FISHEYE if chosen.scene.lens == "fisheye" else LensModel()
        inputs = [CameraInput(camera.name, camera.image_size, model) for camera in session.rig.cameras]
        views = [TargetView(*view) for view in session.views]
        problems = [Problem(inputs, views, BOARD)]
        if self.options.peers:
            lenses = [camera.intrinsics for camera in session.rig.cameras]
            known = [with_known_lens(own, lens, EXACT) for own, lens in zip(inputs, lenses)]
            problems.append(Problem(known, views, BOARD, lenses))
        for problem in problems:
            for row in self._rows(problem, session, chosen.clocks):
                yield {**row, "case": name, "seed": seed, "intrinsics": problem.intrinsics}

    def _wand_row(self, chosen: BoardCase, wand: Wand, seed: int) -> Row:
        """Return the row of a wand, with lenses that are as wrong as their covariance states."""
        session, rng = simulate_board(chosen.scene, wand.points, seed), np.random.default_rng(seed)
        inputs = uncertain_inputs(session.rig, CALIBRATED, rng)
        views = [TargetView(*view) for view in session.views]
        empty: Row = dict.fromkeys(column.key for column in self.columns) | {"program": OWN, "note": ""}
        begin = time.perf_counter()
        try:
            start = start_wand(inputs, views, wand.points)
            found = calibrate_from(start, inputs, wand.points, chosen.clocks)
        except CalibrationError as error:
            return {**empty, "failed": 1.0, "note": str(error)}
        solve_s = time.perf_counter() - begin
        return {**empty, "failed": 0.0, "solve_s": solve_s, **errors_of(found, session)}

    def _rows(self, problem: Problem, session: BoardSession, clocks: bool) -> Iterator[Row]:
        """Yield the row of this project and those of other libraries."""
        empty: Row = dict.fromkeys(column.key for column in self.columns) | {"failed": 1.0, "note": ""}
        bound: Row = {}
        points = None
        begin = time.perf_counter()
        try:
            found = calibrate_rig(problem.cameras, problem.views, BOARD.points, clocks=clocks)
        except CalibrationError as error:
            yield {**empty, "program": OWN, "note": str(error)}
        else:
            solve_s = time.perf_counter() - begin
            points = space_of(found)
            errors = errors_of(found, session)
            bound = {"predicted_m": errors["predicted_m"]}
            yield {**empty, "program": OWN, "failed": 0.0, "solve_s": solve_s, **errors}
        for attempt in attempts(problem, self.options.peers) if self.options.peers else ():
            row = {**empty, **bound, "program": attempt.program, "note": attempt.note}
            if attempt.rig is not None:
                row |= {"failed": 0.0, "solve_s": attempt.solve_s}
                row |= camera_errors(attempt.rig, session.rig, points)
                row["ratio"] = row["error_m"] / row["predicted_m"] if bound else None
            yield row

    def lines(self, result: Result) -> Iterable[str]:
        """See `Study`; reasons of failures and remarks of libraries follow the table."""
        notes = {
            f"{row['case']}, {row['program']}, intrinsics {row['intrinsics']}: {row['note']}": None
            for row in result["rows"]
            if row["note"]
        }
        return [*super().lines(result), *([""] if notes else []), *notes]

    def head(self, result: Result) -> str:
        """See `Study`."""
        return (
            "Simulated board of 7 x 10 corners of 60 mm, or wand of 500 mm with 2 or 3 markers. Noise 0.3\n"
            "px. "
            "Cases: cameras x instants. "
            "Errors of rotation, position and focal length: medians over cameras.\n"
            "Error: of points in the space of the board, triangulated from exact pixels, after rigid "
            "alignment.\nBound: the same from the Cramer-Rao bound."
        )


def uncertain_inputs(rig: Rig, sd: tuple[float, float, float], rng: np.random.Generator) -> list[CameraInput]:
    """Return cameras with lenses that are as wrong as their covariance states.

    Args:
        sd: Standard deviations, see `with_known_lens`.
    """
    inputs = []
    for camera in rig.cameras:
        own = CameraInput(camera.name, camera.image_size)
        lens, information = with_known_lens(own, camera.intrinsics, sd).known or (None, None)
        assert lens is not None and information is not None
        drawn = lens + rng.standard_normal(len(lens)) / np.sqrt(np.diag(information))
        drawn[4 + len(camera.intrinsics.distortion) :] = 0.0
        inputs.append(own._replace(known=(drawn, information)))
    return inputs


def _cost(scene: BoardScene) -> float:
    return float(scene.instants * scene.cameras)


def errors_of(found: CalibratedRig, session: BoardSession) -> Row:
    """Return the errors of a calibration against the truth, relative to the first camera, and its bound."""
    states, points = found.state.cameras, space_of(found)
    rig = rig_in_world(found, Rigid.identity())
    errors = camera_errors(rig, session.rig, points)
    apart = poses_apart(rig, session.rig)
    nees = []
    for c in range(1, len(rig)):
        rows = found.index[c, :POSE]
        nees.append(apart[c] @ np.linalg.solve(found.covariance[np.ix_(rows, rows)], apart[c]) / POSE)
    predicted = float(np.sqrt((predicted_errors(found, points) ** 2).mean()))
    free = found.index[:, OFFSET] >= 0
    late = (states.offsets - states.offsets[0]) - (session.offsets - session.offsets[0])
    return {
        **errors,
        "predicted_m": predicted,
        "ratio": errors["error_m"] / predicted,
        "nees": float(np.mean(nees)),
        "offset_s": float(np.sqrt((late[free] ** 2).mean())) if free.any() else np.nan,
    }


def camera_errors(rig: Rig, truth: Rig, points: Array | None) -> Row:
    """Return the errors of cameras against the truth, relative to the first camera, whose frame `rig` has.

    Args:
        points: (N, 3) m, points in which triangulation is scored; None = it is not.
    """
    apart = poses_apart(rig, truth)
    focal = [
        own.intrinsics.matrix[0, 0] / true.intrinsics.matrix[0, 0] - 1.0
        for own, true in zip(rig.cameras, truth.cameras)
    ]
    error = np.nan
    if points is not None:
        error = np.sqrt((triangulation_errors(rig, truth, points) ** 2).mean())
    return {
        "rotation_rad": float(np.median(np.linalg.norm(apart[1:, :3], axis=1))),
        "position_m": float(np.median(np.linalg.norm(apart[1:, 3:], axis=1))),
        "focal": float(np.median(np.abs(focal))),
        "error_m": float(error),
    }


def poses_apart(rig: Rig, truth: Rig) -> Array:
    """Return the rotation vectors, rad, and translations, m, (C, 6) from cameras to their truth."""
    reference = truth.cameras[0].cam_from_world.inverse()
    true = [camera.cam_from_world.compose(reference) for camera in truth.cameras]
    own = [camera.cam_from_world for camera in rig.cameras]
    turns = np.stack([t.rotation @ o.rotation.T for t, o in zip(true, own)])
    moves = np.stack([t.translation - o.translation for t, o in zip(true, own)])
    return np.concatenate([vectors_of(np.ascontiguousarray(turns)), moves], axis=1)


def triangulation_errors(rig: Rig, truth: Rig, points: Array) -> Array:
    """Return the errors (N,) m of points (N, 3) m, of the frame of the first camera, after rigid alignment.

    True cameras project them, the cameras of `rig` triangulate the pixels.
    """
    world_from_first = truth.cameras[0].cam_from_world.inverse()
    pixels = []
    for camera in truth.cameras:
        own, _ = camera.project(world_from_first.apply(points))
        with np.errstate(invalid="ignore"):
            inside = np.all((own > 0.0) & (own < np.array(camera.image_size)), axis=1)
        pixels.append(np.where(inside[:, None], own, np.nan))
    found = triangulated(rig, np.stack(pixels, axis=1))
    good = np.isfinite(found).all(axis=1)
    a, b = found[good], points[good]
    u, _, v = np.linalg.svd((a - a.mean(0)).T @ (b - b.mean(0)))
    turn = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ v))]) @ v
    errors: Array = np.linalg.norm((a - a.mean(0)) @ turn - (b - b.mean(0)), axis=1)
    return errors
