"""`panoptic prior train MOTION ... --out FILE`: train a pose prior from recorded motion."""

from __future__ import annotations

import argparse
from pathlib import Path

from panoptic_ros.running.arguments import output_file
from panoptic_ros.view.progress import PassBar


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the verb."""
    parser.add_argument("action", choices=("train",), help="train a pose prior from motion")
    parser.add_argument(
        "motion",
        type=Path,
        nargs="+",
        help="motion files: .bvh, .c3d, .npz of clips, or kinematics.json.gz of `panoptic kinematics`",
    )
    parser.add_argument(
        "--out", type=output_file, required=True, metavar="FILE", help="prior (.npz) to write"
    )
    parser.add_argument(
        "--leave-out", action="append", default=[], metavar="NAME", help="clip to leave out; repeatable"
    )
    parser.add_argument(
        "--unit", type=float, default=0.01, metavar="M", help="length unit of BVH files, in m (default 0.01)"
    )
    parser.add_argument(
        "--segments",
        default="segments21",
        metavar="NAME",
        help="skeleton of segments: an installed one (default segments21), or a YAML file",
    )


def run(args: argparse.Namespace) -> int:
    """Train and write the prior, and print a summary of the training data."""
    from panoptic_ros.running.prior_training import train_from_files  # imported here to keep --help fast

    with PassBar("prior") as bar:
        lines = train_from_files(args.motion, args.out, args.leave_out, args.unit, bar.show, args.segments)
    print("\n".join(lines))
    return 0
