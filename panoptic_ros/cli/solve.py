"""`panoptic solve`: 2D people to skeletons, with the stages of the graph but without ROS."""
from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np

from panoptic_ros.assembly.config import AssemblyConfig
from panoptic_ros.cli.offsets import add_offset_options, correct
from panoptic_ros.cli.options import add_occluder_option, add_parameter_options
from panoptic_ros.domain import TrackedPoseSet
from panoptic_ros.errors import UsageError
from panoptic_ros.graph.nodes import FUSION
from panoptic_ros.graph.pipeline import Pipeline
from panoptic_ros.io.detector_context import bias_extras
from panoptic_ros.io.plain_formats import PlainDetections, read_detections, write_skeletons
from panoptic_ros.io.rigs import read_rig
from panoptic_ros.io.skeletons import map_joints, skeleton_of
from panoptic_ros.params import config_of
from panoptic_ros.running.parameters import read_parameters, with_defaults, with_occluders
from panoptic_ros.stage import Notice, StageContext


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the verb."""
    parser.add_argument("--rig", type=Path, required=True, help="calibration, any format that `rig` reads")
    parser.add_argument("--detections", type=Path, required=True, help="detections.json(.gz)")
    parser.add_argument("--out", type=Path, required=True, metavar="S", help="skeletons.json(.gz) to write")
    parser.add_argument(
        "--skeleton", default="auto",
        help="skeleton model; auto: the joints of the detections, or panoptic19 for COCO's",
    )  # fmt: skip
    parser.add_argument("--cameras", help="use only these, names separated by commas")
    parser.add_argument("--quiet", action="store_true", help="no summary")
    add_occluder_option(parser)
    add_offset_options(parser)
    add_parameter_options(parser)


def run(args: argparse.Namespace) -> int:
    """Solve a file."""
    parameters = read_parameters(args.config, args.settings)
    everything = with_occluders(read_rig(args.rig), args.occluders)
    rig = everything.subset(args.cameras.split(",")) if args.cameras else everything
    if len(rig) < 2:
        raise UsageError(f"{len(rig)} camera is not enough for 3D; give two or more")
    detections = read_detections(args.detections)
    name = args.skeleton if args.skeleton != "auto" else _choose(detections)
    skeleton, joint_map = map_joints(name, detections.joint_names)
    configs = with_defaults(parameters, {})
    table = config_of(configs, AssemblyConfig).bias_table
    context = StageContext(rig, skeleton, bias_extras(table, skeleton))
    sets = list(detections.sets(rig, joint_map, skeleton.hash, known=everything.names))
    sets = correct(sets, context, configs, args)
    results: list[TrackedPoseSet] = []
    notices: list[Notice] = []
    spent: dict[str, list[int]] = {}
    pipeline = Pipeline(
        configs, context, FUSION,
        on_record=lambda topic, record: results.append(record) if topic == "skeletons" else None,
        on_notice=lambda stage, notice: notices.append(notice),
        on_step=lambda stage, ns: spent.setdefault(stage, []).append(ns),
        clock=time.perf_counter_ns,
    )  # fmt: skip
    for item in sets:
        pipeline.push("detection_sets", item)
    pipeline.flush()
    names = _own_names(detections, skeleton.joint_names, args.skeleton)
    write_skeletons(args.out, names, results)
    if not args.quiet:
        _summary(args.out, results, spent, notices)
    return 0


def _choose(detections: PlainDetections) -> str:
    """The installed skeleton with the joints of the file; panoptic19 for COCO's and for others."""
    found = skeleton_of(detections.joint_names)
    return "panoptic19" if found in (None, "coco17") else found


def _own_names(detections: PlainDetections, joints: tuple[str, ...], asked: str) -> tuple[str, ...]:
    """The joints as the detections spell them, where the skeleton was chosen after them."""
    if asked != "auto":
        return joints
    _, mapping = map_joints(_choose(detections), detections.joint_names)
    return tuple(
        detections.joint_names[s[0]] if len(s) == 1 and len(mapping.sources) == len(detections.joint_names)
        else joint
        for joint, s in zip(joints, mapping.sources)
    )  # fmt: skip


def _summary(
    out: Path, results: list[TrackedPoseSet], spent: dict[str, list[int]], notices: list[Notice]
) -> None:
    ids = sorted({int(i) for item in results for i in item.ids})
    people = float(np.mean([len(item.ids) for item in results])) if results else 0.0
    shown = ", ".join(map(str, ids[:12])) + (", ..." if len(ids) > 12 else "")
    print(f"{out}: {len(results)} frames, {people:.2f} people per frame, {len(ids)} ids ({shown})")
    times = "  ".join(f"{s} {np.median(ns) * 1e-6:.2f}" for s, ns in spent.items())
    if times:
        print(f"milliseconds per frame, median: {times}")
    counts: dict[str, int] = {}
    for notice in notices:
        if notice.severity != "info":
            counts[notice.code] = counts.get(notice.code, 0) + 1
    for code, count in sorted(counts.items()):
        print(f"{count} x {code}", file=sys.stderr)
