"""Calibration from people and from a random pattern, and the end of all calibrations, as commands."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from panoptic_ros.errors import UsageError
from panoptic_ros.running.arguments import camera_distance, within

if TYPE_CHECKING:
    from panoptic_ros.running.calibration.calibrate import BoardCalibration


def add_people_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of people, and the distance, which a pattern needs, too."""
    parser.add_argument(
        "--people",
        action="store_true",
        help="calibrate from people who walk, without a board. FOLDER is a capture folder, results of a run, "
        "a bag, or a file of 2D poses. --intrinsics gives the lenses, unless the recording has a calibration",
    )
    parser.add_argument(
        "--stature",
        type=within(float, 0.5, 2.5),
        metavar="M",
        help="with --people: mean stature of the people, m; it gives the scale",
    )
    parser.add_argument(
        "--distance",
        type=camera_distance,
        metavar="CAM_A,CAM_B=M",
        help="measured distance of two lenses, m: with --people or --pattern it gives the scale, with a "
        "board it checks the square size",
    )


def add_pattern_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of a pattern."""
    parser.add_argument(
        "--pattern",
        action="store_true",
        help="calibrate from a random pattern, projected or printed, with --intrinsics and --distance. "
        "Images of the same number show the same scene in all cameras",
    )
    parser.add_argument(
        "--refine", action="store_true", help="with --pattern: poses of --intrinsics are approximately right"
    )


def run_people(args: argparse.Namespace, out: Path) -> int:
    """Calibrate cameras from people."""
    from panoptic_ros.running.calibration.calibrate_people import (
        calibrate_recorded_people,
        write_people_calibration,
    )
    from panoptic_ros.view.people_report import people_table
    from panoptic_ros.view.progress import PassBar

    with PassBar("people") as bar:
        found = calibrate_recorded_people(
            Path(args.folder),
            args.intrinsics,
            bar.show,
            stature_m=args.stature,
            distance=args.distance,
            synchronous=args.synchronous,
        )
    files = write_people_calibration(out, found)
    for line in (*found.notices, *found.doubts):
        print(f"warning: {line}", file=sys.stderr)
    if not args.quiet:
        print("\n".join(people_table(found.quality.rig, found.predicted)))
        print(f"{out}: {', '.join(files)}")
    return 0


def run_pattern(args: argparse.Namespace, out: Path) -> int:
    """Calibrate cameras with known lenses from a random pattern."""
    from panoptic_ros.io.rigs.intrinsics import read_intrinsics
    from panoptic_ros.running.calibration.calibrate_pattern import calibrate_from_pattern
    from panoptic_ros.view.progress import PassBar

    if args.floor is not None or args.lens != "brown" or args.stature or args.depth_sensor:
        raise UsageError("--floor, --lens, --stature and --depth-sensor are not for --pattern")
    known = read_intrinsics(args.intrinsics) if args.intrinsics else None
    with PassBar("images") as bar:
        found = calibrate_from_pattern(Path(args.folder), known, args.distance, args.refine, bar.show)
    return finish(args, out, found)


def finish(args: argparse.Namespace, out: Path, found: BoardCalibration) -> int:
    """Write the results and print the summary."""
    from panoptic_ros.running.calibration.results import write_calibration
    from panoptic_ros.view.calibration_report import quality_table

    files = write_calibration(out, found)
    for line in (*found.notices, *found.doubts):
        print(f"warning: {line}", file=sys.stderr)
    if not args.quiet:
        print("\n".join(quality_table(found.quality)))
        print(f"{out}: {', '.join(files)}")
    return 0
