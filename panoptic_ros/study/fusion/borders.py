"""The study `borders`: persons cut by image borders, with and without the border model, and an oracle.

The oracle solves without the border model, but with clean input: it removes every 2D joint far from the
projection of its true joint.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from panoptic_ros.domain import Camera, DetectionSet, ViewDetections
from panoptic_ros.errors import UsageError
from panoptic_ros.evaluation import SkeletonSequence, pair_sequences
from panoptic_ros.evaluation.report import report_of
from panoptic_ros.io.compared_skeletons import spelt_alike
from panoptic_ros.running.arguments import within
from panoptic_ros.simulation import SCENES, simulate
from panoptic_ros.stage import Progress
from panoptic_ros.study.ablation.figures import solve
from panoptic_ros.study.ablation.mechanisms import MECHANISMS
from panoptic_ros.study.options import add_recordings, add_seeds, known_names, recordings, words
from panoptic_ros.study.study import Case, Column, Result, Row, Study
from panoptic_ros.study.world import World, recorded_world, rendered_world

Array = np.ndarray
OFF = next(m.off for m in MECHANISMS if m.name == "image-borders")
FAR = 25.0  # px, from the true projection; the oracle removes 2D joints beyond this
SAME = 60.0  # px, limit of the median distance between a 2D pose and the projection of its true skeleton
FIGURES = ("MPJPE mm", "PCK 5 cm", "PCK 10 cm", "people found", "within 95 %")


class Borders(Study):
    """Every case is solved three times: without the model, with it, and by the oracle."""

    columns = (
        Column("case", ""),
        Column("model", "model"),
        *(Column(name, name, ".1f" if "mm" in name else ".4f") for name in FIGURES),
        *(Column(f"share {name}", f"gain {name}", ".0%") for name in FIGURES[:3]),
    )

    @classmethod
    def add_options(cls, parser: argparse.ArgumentParser) -> None:
        """See `Study`."""
        parser.add_argument(
            "--scenes",
            type=words,
            default=["rendered-6p8v"],
            metavar="NAME,NAME",
            help="rendered scenes of `panoptic simulate`; empty = none; default rendered-6p8v",
        )
        add_seeds(parser, "51")
        parser.add_argument(
            "--frames", type=within(int, 1, 10**6), metavar="N", help="greatest number of frames per scene"
        )
        for name, default, text in (
            ("--width", 0.5, "width of the central window of scene images, as a share; default 0.5"),
            ("--height", 1.0, "height of the central window of scene images, as a share; default 1"),
        ):
            parser.add_argument(
                name, type=within(float, 0.1, 1.0), default=default, metavar="SHARE", help=text
            )
        parser.add_argument("--model", default="movenet-multipose", help="detector for scenes")
        add_recordings(parser)

    def cases(self) -> list[Case]:
        """See `Study`."""
        names, seeds = self.options.scenes, self.options.seeds
        known_names(names, [name for name, scene in SCENES.items() if scene.rendered], "rendered scene")
        found = [Case(f"{name} {seed}", (name, seed)) for name in names for seed in seeds]
        found += [Case(" ".join(paths), paths) for paths in recordings(self.options)]
        if not found:
            raise UsageError("there is nothing to solve: give --scenes or --capture")
        return found

    def measure(self, case: Case, progress: Progress) -> list[Row]:
        """See `Study`."""
        given = self.options
        if isinstance(case.request, list):
            world = recorded_world(case.request)
        else:
            name, seed = case.request
            take = simulate(SCENES[name], seed, given.frames or SCENES[name].frames)
            world = rendered_world(take, given.model, (given.width, given.height))
        cleaned = replace(world, sets=tuple(without_far_joints(world)))
        off, on = _figures(world, OFF), _figures(world, {})
        oracle = _figures(cleaned, OFF)
        shares = {f"share {name}": _share(off[name], on[name], oracle[name]) for name in FIGURES}
        runs = {"off": off, "on": on | shares, "oracle": oracle}
        return [{"case": case.title, "model": key} | figures for key, figures in runs.items()]

    def head(self, result: Result) -> str:
        """See `Study`."""
        return "people cut by image borders: without the model, with it, and by an oracle; gain: its share"


def _figures(world: World, settings: dict[str, dict[str, Any]]) -> dict[str, float]:
    assert world.truth is not None  # true for all cases
    found = solve(world, settings).skeletons
    pairs = pair_sequences(world.truth, spelt_alike(found, world.truth))
    scores = report_of(pairs, world.truth.joint_names)
    pck = dict(scores.joints.pck_of_everybody)
    cover = float("nan") if scores.consistency is None else scores.consistency.cover95
    numbers = (scores.joints.mpjpe_mm, pck[0.05], pck[0.1], scores.people.recall, cover)
    return {name: float(number) for name, number in zip(FIGURES, numbers)}


def _share(off: float, on: float, oracle: float) -> float:
    """Return the gain of the model as a share of the oracle's gain."""
    return (on - off) / (oracle - off) if oracle != off else float("nan")


def without_far_joints(world: World) -> Iterator[DetectionSet]:
    """Yield the sets without 2D joints farther than `FAR` px from their true projections."""
    assert world.truth is not None
    stamps = np.array([frame.stamp_ns for frame in world.truth.frames])
    columns = [
        world.truth.joint_names.index(name) if name in world.truth.joint_names else -1
        for name in spelt_alike(SkeletonSequence(world.skeleton.joint_names, ()), world.truth).joint_names
    ]
    cameras = {camera.name: camera for camera in world.rig.cameras}
    for item in world.sets:
        truth = world.truth.frames[int(np.abs(stamps - item.stamp_ns).argmin())].positions
        places = np.full((len(truth), len(columns), 3), np.nan)
        known = np.array(columns) >= 0
        places[:, known] = truth[:, np.array(columns)[known]]
        views = tuple(_cleaned(view, cameras[view.camera], places) for view in item.views)
        yield replace(item, views=views)


def _cleaned(view: ViewDetections, camera: Camera, places: Array) -> ViewDetections:
    """Return the view without 2D joints far from the projection of the matched person's true joints.

    Args:
        places: true joints (P, J, 3), m.
    """
    pixels, seen = camera.project(np.nan_to_num(places))
    inside = seen & camera.contains(pixels) & np.isfinite(places[..., 0])
    points, scores = view.points.copy(), view.scores.copy()
    for d in range(len(points)):
        away = np.linalg.norm(points[d] - np.where(seen[..., None], pixels, np.inf), axis=-1)
        shared = inside & (scores[d] > 0.0)
        medians = [np.median(row[own]) if own.any() else np.inf for row, own in zip(away, shared)]
        if medians and min(medians) < SAME:
            who = int(np.argmin(medians))
            far = (away[who] > FAR) & np.isfinite(places[who, :, 0]) & (scores[d] > 0.0)
            points[d, far], scores[d, far] = np.nan, 0.0
    return replace(view, points=points, scores=scores)
