"""`panoptic solve`: solve 3D poses from 2D poses, with the stages of the graph but without ROS."""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from contextlib import nullcontext
from pathlib import Path
from statistics import fmean, median
from typing import TYPE_CHECKING

from panoptic_ros.cli.offsets import add_offset_options
from panoptic_ros.cli.options import add_occluder_option, add_parameter_options, names
from panoptic_ros.running.arguments import output_file
from panoptic_ros.stage import untold

if TYPE_CHECKING:
    from panoptic_ros.running.solve import SolveResult, SolveTask


TOLD = (
    "sync.clock_off",
    "result.nobody",
    "result.free_running",
    "health.turned",
    "health.zoomed",
    "health.repaired",
)  # notices that are printed in full; others are only counted


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the verb."""
    parser.add_argument("--rig", type=Path, required=True, help="calibration, in any format that `rig` reads")
    parser.add_argument("--detections", type=Path, required=True, help="2D people, detections.json(.gz)")
    parser.add_argument(
        "--out", type=output_file, required=True, metavar="S", help="skeletons.json(.gz) to write"
    )
    parser.add_argument(
        "--skeleton",
        default="",
        help="skeleton model; auto: the model with most joints of the file, panoptic19 for COCO's; "
        "default: that of the preset, or auto",
    )
    parser.add_argument("--cameras", help="use only these cameras, names separated by commas")
    parser.add_argument("--quiet", action="store_true", help="print no summary")
    parser.add_argument(
        "--repair",
        type=output_file,
        metavar="RIG",
        help="correct cameras that turn or zoom during the recording, and write the corrected rig",
    )
    add_occluder_option(parser)
    add_offset_options(parser)
    add_parameter_options(parser)


def run(args: argparse.Namespace) -> int:
    """Solve a file and write the 3D poses."""
    from panoptic_ros.io.plain_formats import write_skeletons  # imported here to keep --help fast
    from panoptic_ros.io.recorded_people import AUTO
    from panoptic_ros.io.rigs import write_rig
    from panoptic_ros.running.plans.parameters import read_parameters
    from panoptic_ros.running.plans.presets import read_preset
    from panoptic_ros.running.solve import check, read_task, solve

    preset = read_preset(args.preset)
    settings = [*args.settings, *(["health.repair=true"] if args.repair else [])]
    task = read_task(
        args.rig,
        args.detections,
        read_parameters(args.config, settings, preset.parameters),
        skeleton=args.skeleton or preset.skeleton or AUTO,
        cameras=names(args.cameras),
        occluders=args.occluders,
    )
    for line in task.context.rig.notices:
        print(f"warning: {line}", file=sys.stderr)
    task = _corrected(task, args)
    warnings = check(task)
    for notice in warnings:
        print(f"warning: {notice.text}", file=sys.stderr)
    solution = solve(task, warnings)
    write_skeletons(args.out, task.joint_names, solution.poses)
    if args.repair and solution.rig is not None:
        write_rig(args.repair, solution.rig)
    if not args.quiet:
        _summary(args.out, solution)
        for line in task.told():
            print(line)
    return 0


def _corrected(task: SolveTask, args: argparse.Namespace) -> SolveTask:
    """Return the task with corrected timestamps, if an option asks for it; print a summary."""
    asked = (args.offsets, args.offsets_from_motion, args.offsets_from_sound)
    if not any((*asked, args.offsets_out, args.trusted_camera)):
        return task
    from panoptic_ros.running.sound.correction import Correction, corrected
    from panoptic_ros.view.progress import PassBar

    correction = Correction(
        args.offsets,
        args.offsets_from_motion,
        args.offsets_from_sound,
        args.apart,
        args.offsets_out,
        args.trusted_camera,
    )
    found = correction.from_motion or correction.from_sound
    with PassBar("clocks") if found else nullcontext() as bar:
        task, told = corrected(task, correction, bar.show if bar else untold)
    if told and not args.quiet:
        print("\n".join(told))
    return task


def _summary(out: Path, solution: SolveResult) -> None:
    poses = solution.poses
    ids = sorted({int(i) for item in poses for i in item.ids})
    people = fmean(len(item.ids) for item in poses) if poses else 0.0
    shown = ", ".join(map(str, ids[:12])) + (", ..." if len(ids) > 12 else "")
    print(f"{out}: {len(poses)} frames, {people:.2f} people per frame, {len(ids)} ids ({shown})")
    times = "  ".join(f"{stage} {median(ns) * 1e-6:.2f}" for stage, ns in solution.spent_ns.items())
    if times:
        print(f"milliseconds per frame, median: {times}")
    for notice in solution.notices:
        if notice.code in TOLD:
            print(f"warning: {notice.text}", file=sys.stderr)
    others = (notice for notice in solution.notices if notice.code not in TOLD)
    counts = Counter(notice.code for notice in others if notice.severity != "info")
    for code, count in sorted(counts.items()):
        print(f"{count} x {code}", file=sys.stderr)
