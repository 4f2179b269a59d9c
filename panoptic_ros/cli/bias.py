"""`panoptic bias measure TRUTH RESULT --out FILE`: measure the constant biases of a detector's joints."""

from __future__ import annotations

import argparse
from pathlib import Path

from panoptic_ros.errors import UsageError
from panoptic_ros.running.arguments import output_file
from panoptic_ros.view.progress import PassBar


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the verb."""
    parser.add_argument("action", choices=("measure",), help="compare a result with a reference")
    parser.add_argument(
        "truth",
        type=Path,
        help="true skeletons, or those of another system; with --segments also bodies, true or from "
        "`panoptic kinematics`",
    )
    parser.add_argument("result", type=Path, help="skeletons of this detector, computed without a bias table")
    parser.add_argument(
        "--out", type=output_file, required=True, metavar="FILE", help="table (YAML) to write"
    )
    parser.add_argument("--detector", default="", metavar="NAME", help="name of the detector, for the file")
    parser.add_argument(
        "--leave-out",
        type=int,
        action="append",
        default=[],
        metavar="ID",
        help="person of the truth to leave out of the measurement; repeatable",
    )
    parser.add_argument(
        "--segments",
        action="store_true",
        help="measure offsets in the frames of a body's segments, in m, for kinematics.offsets; default: "
        "in the frame of the torso",
    )
    parser.add_argument(
        "--bodies",
        type=Path,
        metavar="FILE",
        help="with --segments, if TRUTH has no bodies: bodies of RESULT (default: kinematics.json.gz "
        "beside it)",
    )


def run(args: argparse.Namespace) -> int:
    """Measure and write the biases, and print the benefit of the table for people not used to measure it."""
    from panoptic_ros.running.biases import write_biases  # imported here to keep --help fast
    from panoptic_ros.running.joint_offsets import write_measured_offsets
    from panoptic_ros.view.bias_table import bias_table

    if args.bodies is not None and not args.segments:
        raise UsageError("--bodies belongs to --segments; give both, or neither")
    given = args.truth, args.result, args.out, args.detector, args.leave_out
    with PassBar("biases") as bar:
        if args.segments:
            benefits = write_measured_offsets(*given, args.bodies, bar.show)
        else:
            benefits = write_biases(*given, bar.show)
    print(bias_table(benefits) if benefits else "one person: no other person to validate on")
    return 0
