"""The study `calibration-pattern`: cameras from a projected random pattern, up to hundreds of them."""

from __future__ import annotations

import argparse
import resource
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from panoptic_ros.calibration.pattern.solve import calibrate_pattern
from panoptic_ros.calibration.pattern.tracks import PatternSightings
from panoptic_ros.calibration.projection import POSE
from panoptic_ros.calibration.quality import predicted_errors
from panoptic_ros.calibration.solve import CalibratedRig
from panoptic_ros.calibration.tape import TAPE_SD_M
from panoptic_ros.calibration.world import rig_in_world
from panoptic_ros.domain import Rig
from panoptic_ros.errors import CalibrationError
from panoptic_ros.geometry import Rigid
from panoptic_ros.geometry.rotations import rotations_of
from panoptic_ros.simulation.pattern_sessions import (
    HD,
    HD_FOCAL,
    KINECT,
    KINECT_FOCAL,
    VGA,
    VGA_FOCAL,
    CameraModel,
    PatternScene,
    PatternSession,
    simulate_pattern,
)
from panoptic_ros.stage import Progress
from panoptic_ros.study.calibration.alignment import similarity, triangulated
from panoptic_ros.study.calibration.boards import (
    CALIBRATED,
    ERRORS,
    camera_errors,
    poses_apart,
    uncertain_inputs,
)
from panoptic_ros.study.options import add_cases, add_seeds, known_names
from panoptic_ros.study.study import Case, Column, Result, Row, Study

Array = np.ndarray
SPACE = (np.linspace(-1.0, 1.0, 6), np.linspace(-1.0, 1.0, 6), np.linspace(0.3, 1.7, 5))  # m, space of people
TURN_SD, MOVE_SD_M = np.deg2rad(0.5), 0.02  # rad and m per axis, errors of approximate poses
APPROXIMATE = (0.02, 5.0, 0.05)  # deviations of approximate lenses, see `with_known_lens`
ENTIRE = (
    CameraModel(480, VGA, VGA_FOCAL),
    CameraModel(31, HD, HD_FOCAL),
    CameraModel(10, KINECT, KINECT_FOCAL),
)


@dataclass(frozen=True)
class PatternCase:
    """Case of the study: a scene, and whether approximate poses are given."""

    scene: PatternScene
    approximate: bool = False


CASES = {
    "24": PatternCase(PatternScene((CameraModel(24, VGA, VGA_FOCAL),), scenes=2)),
    "24-outliers": PatternCase(PatternScene((CameraModel(24, VGA, VGA_FOCAL),), scenes=2, outliers=0.02)),
}
LARGE = {
    "480": PatternCase(
        PatternScene((CameraModel(480, VGA, VGA_FOCAL),), scenes=3, points=2000, detected=0.235), True
    ),
    "521-six-scenes": PatternCase(PatternScene(ENTIRE, scenes=6, points=1000, detected=0.212), True),
}


class CalibrationPattern(Study):
    """Errors of cameras from a pattern beside the bound, and time and memory of each step."""

    columns = (
        Column("case", "case"),
        Column("failed", "failed", ".0%"),
        Column("observations", "pixels", ".0f"),
        *ERRORS,
        Column("solve_s", "solve s", ".1f"),
        Column("memory_gb", "memory GB", ".2f"),
    )
    over = ("case",)

    @classmethod
    def add_options(cls, parser: argparse.ArgumentParser) -> None:
        """See `Study`."""
        add_cases(parser, CASES, LARGE)
        add_seeds(parser, "0:10")

    def cases(self) -> list[Case]:
        """See `Study`."""
        every = {**CASES, **LARGE}
        return [
            Case(f"{name}, seed {seed}", (name, seed), float(_points(every[name].scene)))
            for name in known_names(self.options.cases, every, "case")
            for seed in self.options.seeds
        ]

    def measure(self, case: Case, progress: Progress) -> Iterator[Row]:
        """See `Study`."""
        name, seed = case.request
        chosen, rng = {**CASES, **LARGE}[name], np.random.default_rng(seed)
        session = simulate_pattern(chosen.scene, seed)
        inputs = uncertain_inputs(session.rig, APPROXIMATE if chosen.approximate else CALIBRATED, rng)
        poses = _approximate(session.rig, rng) if chosen.approximate else None
        first, second = 0, len(inputs) // 2
        apart = session.rig.cameras[first].centre - session.rig.cameras[second].centre
        tape = (first, second, float(np.linalg.norm(apart)) + TAPE_SD_M * rng.standard_normal())
        sightings = PatternSightings(session.cameras, session.points, session.pixels)
        steps: list[tuple[str, float, float, float]] = []

        def step(share: float, doing: str) -> None:
            steps.append((doing, time.perf_counter(), time.process_time(), memory_gb()))
            progress(share, doing)

        row: Row = {"case": name, "seed": seed, "observations": len(session.pixels), "note": ""}
        begin = time.perf_counter()
        try:
            found = calibrate_pattern(inputs, sightings, tape, step, poses)
        except CalibrationError as error:
            yield {**row, "failed": 1.0, "note": str(error), "steps": []}
            return
        step(1.0, "end")
        row["steps"] = [(own[0], end[1] - own[1], end[2] - own[2], end[3]) for own, end in pairwise(steps)]
        row |= {"failed": 0.0, "solve_s": time.perf_counter() - begin, "memory_gb": memory_gb()}
        yield {**row, **_errors(found, session)}

    def lines(self, result: Result) -> Iterable[str]:
        """See `Study`; steps of large cases and reasons of failures follow the table."""
        notes = [f"{row['case']}, seed {row['seed']}: {row['note']}" for row in result["rows"] if row["note"]]
        for row in result["rows"]:
            if row["case"] in LARGE:
                notes.append(
                    f"{row['case']}, seed {row['seed']}: time, processor time, greatest memory of each step"
                )
                notes += [
                    f"  {doing:12} {seconds:6.1f} s {own:6.1f} s  {gb:.2f} GB"
                    for doing, seconds, own, gb in row["steps"]
                ]
        return [*super().lines(result), *([""] if notes else []), *notes]

    def head(self, result: Result) -> str:
        """See `Study`."""
        return (
            "Simulated pattern on three tents per scene inside a dome of cameras. Noise 0.3 px. Errors of "
            "rotation,\nposition and focal length: medians over cameras. Error: of points in the space of "
            "people, triangulated\nfrom exact pixels, after alignment with scale. Bound: the same from the "
            "Cramer-Rao bound. The memory is\nthe greatest of the process, with the interpreter."
        )


def memory_gb() -> float:
    """Return the greatest resident memory of the process so far, GB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9


def _points(scene: PatternScene) -> int:
    return scene.scenes * scene.points * sum(model.number for model in scene.models)


def _approximate(rig: Rig, rng: np.random.Generator) -> list[Rigid]:
    """Return the poses of the cameras with errors."""
    turns = rotations_of(TURN_SD * rng.standard_normal((len(rig), 3)))
    moves = MOVE_SD_M * rng.standard_normal((len(rig), 3))
    poses = [camera.cam_from_world for camera in rig.cameras]
    return [
        Rigid(turn @ pose.rotation, turn @ pose.translation + move)
        for turn, move, pose in zip(turns, moves, poses)
    ]


def _errors(found: CalibratedRig, session: PatternSession) -> Row:
    """Return the errors of a calibration against the truth, relative to the first camera, and its bound."""
    rig = rig_in_world(found, Rigid.identity())
    grid = np.stack(np.meshgrid(*SPACE, indexing="ij"), -1).reshape(-1, 3)
    pixels = np.full((len(grid), len(rig), 2), np.nan)
    for c, camera in enumerate(session.rig.cameras):
        own, front = camera.project(grid)
        with np.errstate(invalid="ignore"):
            inside = front & ((own > 0.0) & (own < np.array(camera.image_size))).all(axis=1)
        pixels[inside, c] = own[inside]
    placed = triangulated(rig, pixels)
    good = np.isfinite(placed).all(axis=1)
    errors = np.linalg.norm(similarity(placed[good], grid[good]).apply(placed[good]) - grid[good], axis=1)
    error = float(np.sqrt((errors**2).mean()))
    first = session.rig.cameras[0].cam_from_world
    predicted = float(np.sqrt((predicted_errors(found, first.apply(grid[good]), scaled=True) ** 2).mean()))
    apart = poses_apart(rig, session.rig)
    nees = []
    for c in range(1, len(rig)):
        rows = found.index[c, :POSE]
        nees.append(apart[c] @ np.linalg.solve(found.covariance[np.ix_(rows, rows)], apart[c]) / POSE)
    return {
        **camera_errors(rig, session.rig, None),
        "error_m": error,
        "predicted_m": predicted,
        "ratio": error / predicted,
        "nees": float(np.mean(nees)),
    }
