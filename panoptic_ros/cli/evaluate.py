"""`panoptic evaluate TRUTH RESULT`: score 3D poses against the truth."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from panoptic_ros.errors import UsageError, UserError
from panoptic_ros.io.files import known
from panoptic_ros.running.evaluate import PROTOCOLS, evaluate, read_limits


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the verb."""
    truth = "true skeletons (.json or .json.gz), or an annotation"
    parser.add_argument("truth", type=Path, nargs="?", help=truth)
    parser.add_argument("result", type=Path, nargs="?", help="estimated skeletons")
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    parser.add_argument("--plots", type=Path, metavar="DIR", help="also draw the plots into DIR")
    parser.add_argument(
        "--joints",
        metavar="WHICH",
        help="compare only these joints: a skeleton (coco17, ..., or a YAML file) or names separated by "
        "commas",
    )
    parser.add_argument("--skip", type=int, default=0, metavar="N", help="leave out the first N truth frames")
    parser.add_argument(
        "--align-time",
        action="store_true",
        help="first remove a constant offset of the result's timestamps, estimated from the motion",
    )
    parser.add_argument(
        "--protocol",
        choices=PROTOCOLS,
        default=PROTOCOLS[0],
        help="scoring protocol; all but default count correct limbs (PCP) like papers on Shelf and Campus",
    )
    for flag, word in (("--minimum", "least"), ("--maximum", "most")):
        parser.add_argument(
            flag,
            action="append",
            default=[],
            metavar="SCORE=NUMBER",
            help=f"exit with code 2 unless the score (as named by --json) is at {word} this number; "
            "repeatable",
        )
    # option of old versions; `run` reports its new name
    parser.add_argument("--study", help=argparse.SUPPRESS)


def run(args: argparse.Namespace) -> int:
    """Print the scores.

    Raises:
        UserError: (exit code 2) on invalid input and on scores that miss their limits.
    """
    if args.study is not None:
        raise UsageError(f"evaluate --study {args.study} is now `panoptic study {args.study}`")
    if args.result is None:
        raise UsageError("name the truth and the result: panoptic evaluate TRUTH RESULT")
    limits = read_limits(args.minimum, args.maximum)
    scores = evaluate(
        args.truth,
        args.result,
        joints=args.joints,
        skip=args.skip,
        align_time=args.align_time,
        protocol=args.protocol,
        plots=args.plots,
    )
    print(json.dumps(known(scores.values), indent=1) if args.json else scores.table)
    missed = scores.missed(limits)
    if missed:
        raise UserError(f"{args.result} misses its limits: {'; '.join(missed)}")
    return 0
