"""Table rows of the baselines, from the same 2D poses as this project's stages.

The greedy baseline groups 2D poses by ray distance, triangulates linearly and assigns the nearest identity.
It stands for a small script that lifts 2D poses to 3D: no robust weights, no prediction, no noise model. The
other rows triangulate with identities from the simulator.
"""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from panoptic_ros.domain import DetectionSet, Rig
from panoptic_ros.geometry import triangulate_linear, triangulate_robust
from panoptic_ros.study.child import ONE_THREAD, answer_of
from panoptic_ros.study.stage1 import aniposelib_child
from panoptic_ros.study.stage1.rows import Rows, of_points
from panoptic_ros.study.stopwatch import CallTimes

MOST_VIEWS = 31  # limit of views; larger rigs use every n-th view
LARGEST_GAP = 0.06  # m, limit of the median ray distance between two 2D poses of one person
LARGEST_RESIDUAL = 20.0  # px, limit of the reprojection error in the second triangulation
FEWEST_JOINTS = 8  # lower limit of joints of a person, and of joints that two 2D poses share
SAME_PERSON = 0.6  # m, limit of the mean joint distance to the last position of a track
MEMORY = 15  # frames after which a lost track is not continued
Array = np.ndarray
GIVEN = "identities given"
MISSING = "not installed: pip install aniposelib (best in an environment of its own), --aniposelib PYTHON"


class GreedyBaseline:
    """Greedy baseline: 2D poses of each set to skeletons with identity, set by set."""

    def __init__(self, rig: Rig):
        self._cameras = rig.cameras[:: -(-len(rig) // MOST_VIEWS)]
        self._index = {camera.name: i for i, camera in enumerate(self._cameras)}
        count = len(self._cameras)
        self._fewest_views = 2 if count <= 4 else max(3, count // 4)
        self._stack = Rig(self._cameras).stack()
        self._tracks: dict[int, tuple[int, Array]] = {}

    def step(self, item: DetectionSet) -> tuple[Array, Array]:
        """Return identities (P,) and joints (P, J, 3) m of one set; NaN = missing."""
        views, plane, scores = self._gather(item)
        people = [self._solve(views, plane, scores, group) for group in self._groups(views, plane)]
        people = [p for p in people if np.isfinite(p[:, 0]).sum() >= FEWEST_JOINTS]
        return self._identify(item.index, people), np.array(people).reshape(len(people), plane.shape[1], 3)

    def _gather(self, item: DetectionSet) -> tuple[Array, Array, Array]:
        """Return view (D,), undistorted joints (D, J, 2) and scores (D, J) of all 2D poses."""
        records = [view for view in item.views if view.camera in self._index and len(view.points)]
        joints = item.views[0].points.shape[1] if item.views else 0
        views, plane, scores = [np.zeros(0, int)], [np.zeros((0, joints, 2))], [np.zeros((0, joints))]
        for record in records:
            camera = self._index[record.camera]
            views.append(np.full(len(record.points), camera))
            plane.append(self._cameras[camera].intrinsics.undistort(record.points))
            scores.append(record.scores)
        return np.concatenate(views), np.concatenate(plane), np.concatenate(scores)

    def _groups(self, views: Array, plane: Array) -> list[list[int]]:
        """Group 2D poses of one person, at most one per view; merge the nearest pairs first."""
        gaps = self._gaps(views, plane)
        near = np.argwhere(np.triu(gaps < LARGEST_GAP))
        group = [[d] for d in range(len(views))]  # group of each 2D pose; merged poses share one list
        for a, b in near[np.argsort(gaps[tuple(near.T)], kind="stable")]:
            mine, other = group[a], group[b]
            if mine is other or gaps[np.ix_(mine, other)].mean() > LARGEST_GAP:
                continue  # two groups with a view in common have an infinite mean
            mine += other
            for d in other:
                group[d] = mine
        unique = {id(members): members for members in group}
        return [members for members in unique.values() if len(members) >= self._fewest_views]

    def _gaps(self, views: Array, plane: Array) -> Array:
        """Return the median ray distance (D, D) m of common joints; infinite within one view."""
        rotations = self._stack.rotations[views]
        rays = np.einsum("djk,dki->dji", np.concatenate([plane, np.ones_like(plane[..., :1])], -1), rotations)
        rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
        centres = self._stack.centres[views]
        gaps = np.full((len(views), len(views)), np.inf)
        for d in range(len(views)):
            normals = np.cross(rays[d], rays)
            apart = np.abs(np.einsum("djk,dk->dj", normals, centres - centres[d]))
            distances = apart / np.maximum(np.linalg.norm(normals, axis=-1), 1e-6)
            common = np.isfinite(distances).sum(axis=1)
            middle = np.take_along_axis(np.sort(distances, axis=1), (common // 2)[:, None], axis=1)[:, 0]
            gaps[d] = np.where((common >= FEWEST_JOINTS) & (views != views[d]), middle, np.inf)
        return gaps

    def _solve(self, views: Array, plane: Array, scores: Array, group: list[int]) -> Array:
        """Triangulate the joints (J, 3) m of one person twice; the second time without outliers."""
        joints = plane.shape[1]
        seen, weights = np.zeros((joints, len(self._cameras), 2)), np.zeros((joints, len(self._cameras)))
        seen[:, views[group]] = plane[group].swapaxes(0, 1)
        weights[:, views[group]] = np.where(np.isfinite(plane[group][..., 0]), scores[group], 0.0).T
        points = triangulate_linear(self._stack, seen, weights)
        local = np.einsum("cij,nj->nci", self._stack.rotations, points) + self._stack.translations
        misses = np.linalg.norm(local[..., :2] / local[..., 2:] - seen, axis=-1) * self._stack.focals
        kept = np.where(misses < LARGEST_RESIDUAL, weights, 0.0)
        return triangulate_linear(self._stack, seen, kept)

    def _identify(self, index: int, people: list[Array]) -> Array:
        """Return the identity (P,) of the nearest recent skeleton, or a new one; nearest pairs come first."""
        pairs = []
        for number, (last, joints) in self._tracks.items():
            for k, person in enumerate(people if index - last <= MEMORY else []):
                gaps = np.linalg.norm(joints - person, axis=1)
                if np.isfinite(gaps).any() and np.nanmean(gaps) < SAME_PERSON:
                    pairs.append((float(np.nanmean(gaps)), number, k))
        ids: dict[int, int] = {}
        for _, number, k in sorted(pairs):
            if k not in ids and number not in ids.values():
                ids[k] = number
        for k, person in enumerate(people):
            ids.setdefault(k, len(self._tracks))
            self._tracks[ids[k]] = (index, person)
        return np.array([ids[k] for k in range(len(people))], np.int64)


def greedy_rows(rows: Rows) -> None:
    """Add the row of the greedy baseline, from 2D poses to identities."""
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
    """Add the rows of triangulation alone, with the true association of the simulator."""
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
    """Add the row of aniposelib's triangulation.

    It runs in a separate interpreter, because aniposelib depends on large packages.
    """
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
    times = CallTimes.of(wall, cpu, None)
    results = [
        _numbered((item.stamp_ns, points.reshape(people, joints, 3)))
        for item, points in zip(world.sets, positions)
    ]
    rows.add(step, method, times, results, GIVEN)
