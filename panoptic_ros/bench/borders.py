"""The bench `borders`: people whom image borders cut, with and without the model of borders, and an oracle.

The oracle solves without the model, but without every 2D joint that lies far from its true projection.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from panoptic_ros.bench.ablation.figures import solve
from panoptic_ros.bench.ablation.mechanisms import MECHANISMS
from panoptic_ros.bench.ablation.worlds import recorded_case
from panoptic_ros.bench.rendered import SKELETON, detected_sets, instants_of
from panoptic_ros.bench.stage1.world import World, truth_of
from panoptic_ros.domain import Camera, DetectionSet, Rig, ViewDetections, ViewFrame
from panoptic_ros.errors import UsageError
from panoptic_ros.evaluation import SkeletonFrame, SkeletonSequence, pair_sequences
from panoptic_ros.evaluation.report import report_of
from panoptic_ros.io.compared_skeletons import spelt_alike
from panoptic_ros.io.detector_context import detector_extras
from panoptic_ros.simulation import SCENES, Simulation, simulate
from panoptic_ros.stage import Progress, StageContext, each, untold

Array = np.ndarray
OFF = next(m.off for m in MECHANISMS if m.name == "image-borders")
FAR = 25.0  # px, from the true projection, beyond which the oracle leaves a 2D joint out
SAME = 60.0  # px, largest median distance between a 2D person and the projection of a true person
SEEN_SHARE, SEEN_BY = 1.0 / 3.0, 2  # share of joints in an image, and number of such cameras; fewer: ignored
FIGURES = ("MPJPE mm", "PCK 5 cm", "PCK 10 cm", "people found", "within 95 %")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the bench."""
    parser.add_argument(
        "--scenes",
        default="rendered-6p8v",
        metavar="NAME,NAME",
        help="rendered ones of `panoptic simulate`; empty = none; default rendered-6p8v",
    )
    parser.add_argument("--seed", type=int, default=51, metavar="N", help="of the scenes; default 51")
    parser.add_argument("--frames", type=int, metavar="N", help="of each scene at most")
    parser.add_argument(
        "--width",
        type=float,
        default=0.5,
        metavar="SHARE",
        help="of the images of scenes, in the middle; default 0.5",
    )
    parser.add_argument("--height", type=float, default=1.0, metavar="SHARE", help="the same; default 1")
    parser.add_argument("--model", default="movenet-multipose", help="detector of scenes")
    parser.add_argument(
        "--capture",
        nargs=2,
        action="append",
        default=[],
        metavar=("BAG", "TRUTH"),
        dest="captures",
        help="a bag (or folder) of `panoptic run`, as it is, and its truth. May be given several times",
    )


def measure(args: argparse.Namespace, progress: Progress = untold) -> dict[str, Any]:
    """Solve every case three times.

    Raises:
        UsageError: on scenes that are not there or not rendered, and shares beyond 0 to 1.
        UserError: if a recording or the detector cannot be read.
    """
    names = [name for name in args.scenes.split(",") if name]
    for name in names:
        if name not in SCENES or not SCENES[name].rendered:
            rendered = ", ".join(key for key, scene in SCENES.items() if scene.rendered)
            raise UsageError(f"--scenes {name}: there is no such rendered scene; there are {rendered}")
    for option in ("width", "height"):
        if not 0.1 <= getattr(args, option) <= 1.0:
            raise UsageError(f"--{option} {getattr(args, option)}: it must be between 0.1 and 1")
    if not names and not args.captures:
        raise UsageError("there is nothing to solve: give --scenes or --capture")
    count = len(names) + len(args.captures)
    cases = each(_cases(args, names), count, progress, "cases")
    return {"bench": "borders", "rows": [_rows(*case) for case in cases]}


def _cases(args: argparse.Namespace, names: list[str]) -> Iterator[tuple[str, World, tuple[str, ...]]]:
    for name in names:
        scene = SCENES[name]
        take = simulate(scene, args.seed, scene.frames if args.frames is None else args.frames)
        world = _cropped_world(take, (args.width, args.height), args.model)
        yield f"{name} {args.seed}", world, world.skeleton.joint_names
    for paths in args.captures:
        case = recorded_case(paths)
        yield " ".join(paths), case.world, case.names


def _rows(title: str, world: World, names: tuple[str, ...]) -> dict[str, Any]:
    cleaned = replace(world, sets=tuple(without_far_joints(world)))
    runs = {"off": (world, OFF), "on": (world, {}), "oracle": (cleaned, OFF)}
    return {"case": title} | {key: _figures(*run, names) for key, run in runs.items()}


def _figures(world: World, settings: dict[str, dict[str, Any]], names: tuple[str, ...]) -> dict[str, float]:
    assert world.truth is not None  # all cases have one
    found = solve(world, settings, names).skeletons
    pairs = pair_sequences(world.truth, spelt_alike(found, world.truth))
    scores = report_of(pairs, world.truth.joint_names)
    pck = dict(scores.joints.pck_of_everybody)
    cover = float("nan") if scores.consistency is None else scores.consistency.cover95
    numbers = (scores.joints.mpjpe_mm, pck[0.05], pck[0.1], scores.people.recall, cover)
    return {name: float(number) for name, number in zip(FIGURES, numbers)}


def lines(result: dict[str, Any]) -> list[str]:
    """Return the rows of the table; the last row of a case is the share of the oracle's gain, %."""
    text = [f"{'':<30} model  " + "".join(f"{name:>14}" for name in FIGURES)]
    for row in result["rows"]:
        for key in ("off", "on", "oracle"):
            numbers = "".join(f"{row[key][name]:14.{1 if 'mm' in name else 4}f}" for name in FIGURES)
            text.append(f"{row['case'][-30:] if key == 'off' else '':<30} {key:<6}" + numbers)
        shares = "".join(f"{_share(row, name):13.0f}%" for name in FIGURES[:3])
        text.append(f"{'':<30} share " + shares)
    return text


def _share(row: dict[str, Any], name: str) -> float:
    gain = row["oracle"][name] - row["off"][name]
    return 100.0 * (row["on"][name] - row["off"][name]) / gain if gain else float("nan")


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
    """Return the view without 2D joints far from the projection of the true joints (P, J, 3) m they match."""
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


def _cropped_world(take: Simulation, shares: tuple[float, float], model: str) -> World:
    """Detect people in the middle windows of a take's images; people seen by few cameras are ignored."""
    windows = {camera.name: _window(camera, shares) for camera in take.rig.cameras}
    rig = replace(take.rig, cameras=tuple(_cropped(c, windows[c.name]) for c in take.rig.cameras))
    skeleton, extras = detector_extras(model, SKELETON)
    context = StageContext(rig, skeleton, extras)
    instants = (
        [_cut(frame, windows[frame.camera]) for frame in frames] for frames in instants_of(take, rig.names)
    )
    truth = truth_of(take)
    frames = tuple(_with_ignored(frame, rig) for frame in truth.frames)
    return World(rig, skeleton, tuple(detected_sets(context, instants)), (), replace(truth, frames=frames))


def _window(camera: Camera, shares: tuple[float, float]) -> tuple[int, int, int, int]:
    """Left, top, width and height of the middle of an image, px."""
    (width, height), (across, down) = camera.image_size, shares
    w, h = int(width * across) // 2 * 2, int(height * down) // 2 * 2
    return (width - w) // 2, (height - h) // 2, w, h


def _cropped(camera: Camera, window: tuple[int, int, int, int]) -> Camera:
    """Return the camera of a window (left, top, width, height) px of its images."""
    left, top, width, height = window
    matrix = camera.intrinsics.matrix.copy()
    matrix[:2, 2] -= left, top
    return replace(camera, image_size=(width, height), intrinsics=replace(camera.intrinsics, matrix=matrix))


def _cut(frame: ViewFrame, window: tuple[int, int, int, int]) -> ViewFrame:
    left, top, width, height = window
    return replace(frame, image=np.ascontiguousarray(frame.image[top : top + height, left : left + width]))


def _with_ignored(frame: SkeletonFrame, rig: Rig) -> SkeletonFrame:
    """Mark true people as ignored if fewer than `SEEN_BY` cameras show a third of their joints."""
    shares = [camera.sees(np.nan_to_num(frame.positions)).mean(axis=1) for camera in rig.cameras]
    seldom = (np.array(shares) > SEEN_SHARE).sum(axis=0) < SEEN_BY
    return replace(frame, ignored=frame.ignored | seldom)
