"""`panoptic evaluate TRUTH RESULT`: scores of skeletons against the truth."""
from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from panoptic_ros.cli.evaluate_study import add_study_arguments, run_study
from panoptic_ros.errors import DataError, UsageError, UserError
from panoptic_ros.evaluation import (
    PCP_RULES,
    SkeletonSequence,
    evaluate_pcp,
    failures,
    find_time_offset,
    pair_sequences,
    parse_limit,
    pcp_table,
    report_table,
    shifted,
)
from panoptic_ros.evaluation.report import report_of
from panoptic_ros.running.compared_skeletons import only_joints, read_sequence, spelt_alike


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    truth = "true skeletons (.json or .json.gz), or an annotation"
    parser.add_argument("truth", type=Path, nargs="?", help=truth)
    parser.add_argument("result", type=Path, nargs="?", help="estimated skeletons")
    parser.add_argument("--json", action="store_true", help="print JSON in place of a table")
    parser.add_argument("--plots", type=Path, metavar="DIR", help="also draw the plots into DIR")
    parser.add_argument(
        "--joints", metavar="WHICH",
        help="compare only these: a skeleton (coco17, ..., or a YAML file) or names separated by commas",
    )  # fmt: skip
    parser.add_argument("--skip", type=int, default=0, metavar="N", help="leave out the first N truth frames")
    parser.add_argument(
        "--align-time", action="store_true",
        help="first remove a constant offset of the result's stamps, found from the motion",
    )  # fmt: skip
    parser.add_argument(
        "--protocol", choices=["default", *PCP_RULES], default="default",
        help="count right limbs (PCP) as papers on Shelf and Campus do",
    )  # fmt: skip
    for flag, word in (("--minimum", "least"), ("--maximum", "most")):
        parser.add_argument(
            flag, action="append", default=[], metavar="SCORE=NUMBER",
            help=f"exit with 2 unless the score (as named by --json) is at {word} this; repeatable",
        )  # fmt: skip
    add_study_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Print the scores; raises UserError (exit code 2) on bad input and on missed bars."""
    if args.study is not None:
        if args.truth is not None:
            raise UsageError(f"--study {args.study} simulates its own truth; leave out {args.truth}")
        return run_study(args)
    if args.result is None:
        raise UsageError("name the truth and the result: panoptic evaluate TRUTH RESULT, or --study NAME")
    if args.skip < 0:
        raise UsageError(f"--skip {args.skip} is negative")
    limits = [parse_limit(text) for text in args.minimum]
    limits += [parse_limit(text, upper=True) for text in args.maximum]
    truth, result = read_sequence(args.truth), read_sequence(args.result)
    if not truth.frames:
        raise DataError(f"{args.truth} has no frames")
    if args.joints is not None:
        if args.protocol in PCP_RULES:
            raise UsageError("--joints needs the default protocol; those of PCP are fixed")
        truth = only_joints(truth, args.joints)
    result = spelt_alike(result, truth)
    offset = None
    if args.align_time:
        offset = find_time_offset(truth, result)
        result = shifted(result, offset.seconds)
    if args.protocol in PCP_RULES:
        if args.plots is not None:
            raise UsageError("--plots needs the default protocol")
        pcp = evaluate_pcp(_without_first(truth, args.skip), result, args.protocol)
        scores, table = pcp.to_mapping(), pcp_table(pcp)
    else:
        pairs = pair_sequences(truth, result, args.skip)
        report = report_of(pairs, truth.joint_names)
        scores, table = report.to_mapping(), report_table(report)
        if args.plots is not None:
            _plot(args.plots, pairs, truth.joint_names)
    if offset is not None:
        scores["time_offset_ms"] = 1e3 * offset.seconds
        table += f"\n\n{1e3 * offset.seconds:.1f} ms were added to the result's stamps"
    print(json.dumps(scores, indent=1) if args.json else table)
    missed = failures(scores, limits)
    if missed:
        raise UserError(f"{args.result} misses its bars: {'; '.join(missed)}")
    return 0


def _without_first(sequence: SkeletonSequence, skip: int) -> SkeletonSequence:
    return SkeletonSequence(sequence.joint_names, sequence.frames[skip:])


def _plot(folder: Path, pairs: list[Any], joint_names: tuple[str, ...]) -> None:
    from panoptic_ros.view.evaluation_plots import write_plots  # matplotlib is slow to load

    write_plots(folder, pairs, joint_names)
