"""`panoptic kinematics`: solve bodies with joint angles from cameras, IMUs or both, without ROS."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from panoptic_ros.running.arguments import output_file


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the verb."""
    parser.add_argument("--rig", type=Path, help="calibration, for --detections")
    parser.add_argument("--detections", type=Path, help="2D people, detections.json(.gz)")
    parser.add_argument(
        "--imu", type=Path, metavar="I", help="IMU data, imu.csv(.gz), with or without cameras"
    )
    parser.add_argument(
        "--subject",
        type=Path,
        required=True,
        action="append",
        metavar="FILE",
        help="subject.json of a designated person; repeat it for each person",
    )
    parser.add_argument(
        "--lag", type=float, metavar="S", help="delay over which later data smooth the poses, 0 to 0.2"
    )
    parser.add_argument("--rate", type=float, metavar="HZ", help="rate of the poses; default 60")
    parser.add_argument(
        "--preset",
        default="",
        metavar="NAME",
        help="parameter preset; malleson-2020: solve every frame as in the paper",
    )
    parser.add_argument("--prior", default="", metavar="FILE", help="pose prior; default: the installed one")
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        dest="settings",
        metavar="NAME=VALUE",
        help="one parameter of kinematics; repeatable",
    )
    parser.add_argument(
        "--out", type=output_file, required=True, metavar="K", help="kinematics.json(.gz) to write"
    )
    parser.add_argument("--quiet", action="store_true", help="print no summary")


def run(args: argparse.Namespace) -> int:
    """Solve the files and write the bodies."""
    from panoptic_ros.io.body_files import write_bodies  # imported here to keep --help fast
    from panoptic_ros.running.kinematics import body_config, read_body_task, solve_bodies

    config = body_config(args.preset, args.settings, lag=args.lag, rate_hz=args.rate)
    task = read_body_task(args.subject, config, args.rig, args.detections, args.imu, args.prior)
    solved = solve_bodies(task)
    write_bodies(args.out, task.model, solved.states)
    if not args.quiet:
        instants = len({state.stamp_ns for state in solved.states})
        print(f"{args.out}: {instants} instants, {len(task.subjects)} subjects")
    for line in solved.notices:
        print(line, file=sys.stderr)
    return 0
