"""Rows of named baselines on the same 2D people."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from panoptic_ros.domain import DetectionSet
from panoptic_ros.geometry import triangulate_linear, triangulate_robust
from panoptic_ros.study.child import ONE_THREAD, answer_of
from panoptic_ros.study.stage1 import aniposelib_child
from panoptic_ros.study.stage1.greedy import GreedyBaseline
from panoptic_ros.study.stage1.rows import Rows, of_points
from panoptic_ros.study.stopwatch import Times

Array = np.ndarray
GIVEN = "identities given"
MISSING = "not installed: pip install aniposelib (best in an environment of its own), --aniposelib PYTHON"


def greedy_rows(rows: Rows) -> None:
    """The whole way from 2D people to identities."""
    baseline = GreedyBaseline(rows.world.rig)

    def step(item: DetectionSet) -> tuple[int, Array, Array]:
        return item.stamp_ns, *baseline.step(item)

    rows.run(
        "2D people to ids",
        "greedy, DLT, nearest id (baseline)",
        step,
        rows.world.sets,
        lambda result: of_points(*result),
    )


def given_rows(rows: Rows, anipose: str | None) -> None:
    """Triangulation alone, of the 2D joints that the simulator says are of one person's joint."""
    world = rows.world
    stack = world.rig.stack()
    stamps = [item.stamp_ns for item in world.sets]
    frames = [(stamp, *given) for stamp, given in zip(stamps, world.given)]

    def plane_of(pixels: Array) -> Array:
        flat = pixels.reshape(-1, len(world.rig), 2)
        return np.stack([c.intrinsics.undistort(flat[:, k]) for k, c in enumerate(world.rig.cameras)], axis=1)

    def linear(frame: tuple[int, Array, Array]) -> tuple[int, Array]:
        stamp, pixels, scores = frame
        points = triangulate_linear(stack, plane_of(pixels), scores.reshape(-1, len(world.rig)))
        return stamp, points.reshape(*pixels.shape[:2], 3)

    def robust(frame: tuple[int, Array, Array]) -> tuple[int, Array]:
        stamp, pixels, scores = frame
        sigmas = np.where(scores > 0.0, 2.0 * np.exp(1.2 * (0.72 - scores)), np.nan)
        points = triangulate_robust(stack, plane_of(pixels), sigmas.reshape(-1, len(world.rig))).points
        return stamp, points.reshape(*pixels.shape[:2], 3)

    for method, call in (("batched DLT (baseline)", linear), ("robust, numpy", robust)):
        rows.run("triangulation", method, call, frames, _numbered, GIVEN)
    _anipose_row(rows, anipose)


def _numbered(result: tuple[int, Array]) -> Any:
    stamp, positions = result
    return of_points(stamp, np.arange(len(positions)), positions)


def _anipose_row(rows: Rows, python: str | None) -> None:
    """aniposelib's triangulation, in its own interpreter: it brings large packages with it."""
    method, step = "aniposelib (baseline)", "triangulation"
    if python is None and importlib.util.find_spec("aniposelib") is None:
        rows.add(step, method, None, None, MISSING)
        return
    world = rows.world
    pixels = np.stack([pixels for pixels, _ in world.given])  # (F, P, J, C, 2)
    frames, people, joints, cameras = pixels.shape[:4]
    points = pixels.reshape(frames, people * joints, cameras, 2).swapaxes(1, 2)
    lenses = [camera.intrinsics for camera in world.rig.cameras]
    stack = world.rig.stack()
    with tempfile.TemporaryDirectory() as folder:
        inputs, outputs = Path(folder) / "in.npz", Path(folder) / "out.npz"
        np.savez(
            inputs,
            points=points,
            matrices=[lens.matrix for lens in lenses],
            distortions=[lens.distortion for lens in lenses],
            rotations=stack.rotations,
            translations=stack.translations,
            budget_s=rows.budget_s,
        )
        command = [python or sys.executable, str(Path(aniposelib_child.__file__)), str(inputs), str(outputs)]
        answer_of(
            subprocess.run(
                command, text=True, capture_output=True, env={**os.environ, **ONE_THREAD}, check=False
            ),
            "aniposelib",
        )
        with np.load(outputs) as found:
            positions, wall, cpu = found["positions"], found["wall_ms"], found["cpu_ms"]
    times = Times.of(wall, cpu, None)
    results = [
        _numbered((item.stamp_ns, points.reshape(people, joints, 3)))
        for item, points in zip(world.sets, positions)
    ]
    rows.add(step, method, times, results, GIVEN)
