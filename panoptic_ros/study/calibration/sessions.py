"""The study `calibration-sessions`: cameras from recorded corners of a board, scored on corners left out."""

from __future__ import annotations

import argparse
import csv
import time
from collections import defaultdict
from collections.abc import Iterator
from itertools import combinations
from pathlib import Path
from typing import NamedTuple

import numpy as np

from panoptic_ros.calibration.quality import quality_of
from panoptic_ros.calibration.rig_start import CameraInput
from panoptic_ros.calibration.solve import calibrate_rig
from panoptic_ros.calibration.target_views import TargetView
from panoptic_ros.calibration.world import rig_in_world
from panoptic_ros.domain import Rig
from panoptic_ros.errors import CalibrationError, DataError, UsageError
from panoptic_ros.geometry import Rigid
from panoptic_ros.io.loading import parsing, read_bytes
from panoptic_ros.io.rigs import read_rig
from panoptic_ros.io.stamps import read_stamps
from panoptic_ros.running.calibration.recorded_board import board_of
from panoptic_ros.stage import Progress
from panoptic_ros.study.calibration.alignment import triangulated
from panoptic_ros.study.calibration.peers import OWN, Problem, add_peers, attempts, with_known_lens
from panoptic_ros.study.study import Case, Column, Result, Row, Study

Array = np.ndarray
SLOW_PX_S = 15.0  # px/s, image speed below which clocks of cameras do not count
CORNERS, STAMPS, LENSES = "corners.csv", "timestamps.csv", "caliscope_rig.json"  # files of a session
# Deviations of given lenses: focal length (relative), principal point (px), distortion. Lenses that are
# calibrated apart differ by this much from those of a session.
LENS_SD = (0.01, 5.0, 0.1)
GROUPS = {"slow": SLOW_PX_S, "all": float("inf")}


class RecordedCorner(NamedTuple):
    """Corner in an image: instant, camera, frame, point, pixel, image speed px/s, left out or not."""

    instant: int
    camera: str
    frame: int
    point: int
    pixel: tuple[float, float]
    speed: float
    left_out: bool


class CalibrationSessions(Study):
    """Residuals and distances between corners that the calibration did not see."""

    columns = (
        Column("session", "session"),
        Column("program", "program"),
        Column("intrinsics", "intrinsics"),
        Column("corners", "corners"),
        Column("points", "points"),
        Column("residual_px", "residual px", ".3f"),
        Column("distance_m", "distance mm", ".2f", 1e3),
        Column("median_m", "median mm", ".2f", 1e3),
        Column("scale", "scale", "+.2%"),
        Column("asynchronous", "not synchronous"),
        Column("predicted_m", "predicted mm", ".2f", 1e3),
        Column("solve_s", "solve s", ".2f"),
        Column("note", "note"),
    )

    @classmethod
    def add_options(cls, parser: argparse.ArgumentParser) -> None:
        """See `Study`."""
        parser.add_argument(
            "--session",
            action="append",
            type=Path,
            required=True,
            metavar="DIR",
            help=f"folder with {CORNERS} (sync_index, camera, frame, corner, x, y, speed_px_s, split) and "
            f"{STAMPS}; repeatable",
        )
        parser.add_argument("--board", required=True, help="board, as for `panoptic calibrate`")
        parser.add_argument("--size", default="1280x720", help="size of the images; default 1280x720")
        add_peers(parser)

    def cases(self) -> list[Case]:
        """See `Study`."""
        self._board = board_of(self.options.board)
        if self.options.peers and self._board.kind == "aprilgrid":
            raise UsageError("other libraries calibrate from charuco and checkerboard boards; omit --peers")
        return [Case(str(path), path) for path in self.options.session]

    def measure(self, case: Case, progress: Progress) -> Iterator[Row]:
        """See `Study`."""
        folder, board = case.request, self._board
        corners = _read_corners(folder / CORNERS)
        names = sorted({corner.camera for corner in corners})
        width, height = (int(word) for word in self.options.size.split("x"))
        inputs = [CameraInput(name, (width, height)) for name in names]
        views = _views(corners, names, folder / STAMPS)
        problems = [Problem(inputs, views, board)]
        if self.options.peers and (folder / LENSES).is_file():
            given = read_rig(folder / LENSES)
            lenses = [given.camera(name).intrinsics for name in names]
            known = [with_known_lens(own, lens, LENS_SD) for own, lens in zip(inputs, lenses)]
            problems.append(Problem(known, views, board, lenses))
        left_out = [corner for corner in corners if corner.left_out]
        for problem in problems:
            for rig, row in self._calibrations(problem):
                row |= {"session": folder.name, "intrinsics": problem.intrinsics}
                for title, limit in GROUPS.items():
                    own = [corner for corner in left_out if corner.speed < limit]
                    yield {**row, "corners": title, **(_scores(rig, own, board.points) if rig else {})}

    def _calibrations(self, problem: Problem) -> Iterator[tuple[Rig | None, Row]]:
        """Yield the cameras of each program, None if it failed, and values common to all corners."""
        begin = time.perf_counter()
        try:
            found = calibrate_rig(problem.cameras, problem.views, problem.board.points)
        except CalibrationError as error:
            yield None, {"program": OWN, "note": str(error)}
        else:
            solve_s = time.perf_counter() - begin
            quality = quality_of(found)
            late = [camera.name for camera in quality.cameras if camera.asynchronous]
            yield (
                rig_in_world(found, Rigid.identity()),
                {
                    "program": OWN,
                    "asynchronous": ", ".join(late) or "none",
                    "predicted_m": quality.error_m,
                    "solve_s": solve_s,
                    "note": "",
                },
            )
        for attempt in attempts(problem, self.options.peers) if self.options.peers else ():
            yield attempt.rig, {"program": attempt.program, "solve_s": attempt.solve_s, "note": attempt.note}

    def head(self, result: Result) -> str:
        """See `Study`."""
        return (
            "Corners that the calibration did not see are triangulated: residual per "
            "axis, and error\nof the distances between them (root mean square, median). Slow: below "
            f"{SLOW_PX_S:g} px/s. Scale: median error of distances."
        )


def _read_corners(path: Path) -> list[RecordedCorner]:
    """Return the corners of a file; corners without a speed are fast."""
    rows = csv.DictReader(read_bytes(path).decode("utf-8-sig", "replace").splitlines())
    with parsing(path):
        corners = [
            RecordedCorner(
                int(row["sync_index"]),
                row["camera"],
                int(row["frame"]),
                int(row["corner"]),
                (float(row["x"]), float(row["y"])),
                float(row["speed_px_s"] or "inf"),
                row["split"] == "test",
            )
            for row in rows
        ]
    if not corners:
        raise DataError(f"{path} has no corners")
    return corners


def _views(corners: list[RecordedCorner], names: list[str], stamps: Path) -> list[TargetView]:
    """Return the views of the corners that are not left out, with the stamps of their frames."""
    tables = read_stamps(stamps)
    groups: dict[tuple[int, str, int], list[RecordedCorner]] = defaultdict(list)
    for corner in corners:
        if not corner.left_out:
            groups[corner.instant, corner.camera, corner.frame].append(corner)
    views = []
    for (instant, camera, frame), own in sorted(groups.items()):
        number = camera.rsplit("_", 1)[-1]
        table = tables.get(camera) or tables[number]
        stamp = 1e-9 * (table.stamps_ns[frame] - table.stamps_ns[0])
        own = sorted(own, key=lambda corner: corner.point)
        pixels = np.array([corner.pixel for corner in own])
        numbers = np.array([corner.point for corner in own])
        views.append(TargetView(names.index(camera), instant, stamp, numbers, pixels))
    return views


def _scores(rig: Rig, corners: list[RecordedCorner], points: Array) -> dict[str, float | int]:
    """Return the scores of triangulated corners."""
    groups: dict[tuple[int, int], list[RecordedCorner]] = defaultdict(list)
    for corner in corners:
        groups[corner.instant, corner.point].append(corner)
    groups = {key: own for key, own in groups.items() if len(own) > 1}
    pixels = np.full((len(groups), len(rig), 2), np.nan)
    for n, own in enumerate(groups.values()):
        for corner in own:
            pixels[n, rig.index(corner.camera)] = corner.pixel
    positions = triangulated(rig, pixels)
    misses = [camera.project(positions)[0] - pixels[:, c] for c, camera in enumerate(rig.cameras)]
    placed: dict[int, list[tuple[int, Array]]] = defaultdict(list)
    for (instant, point), position in zip(groups, positions):
        placed[instant].append((point, position))
    lengths = [
        (np.linalg.norm(a - b), np.linalg.norm(points[p] - points[q]))
        for own in placed.values()
        for (p, a), (q, b) in combinations(own, 2)
    ]
    measured, true = np.array(lengths).reshape(-1, 2).T
    return {
        "points": sum(len(own) for own in placed.values()),
        "residual_px": float(np.sqrt(np.nanmean(np.square(misses)))),
        "distance_m": float(np.sqrt(np.mean((measured - true) ** 2))),
        "median_m": float(np.median(np.abs(measured - true))),
        "scale": float(np.median(measured / true) - 1.0),
    }
