"""`panoptic bias measure TRUTH RESULT --out FILE`: the constant biases of a detector's joints."""
from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from panoptic_ros.evaluation.bias import Benefit
from panoptic_ros.running.biases import write_biases
from panoptic_ros.view.progress import PassBar


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    parser.add_argument("action", choices=("measure",), help="compare a result with a reference")
    parser.add_argument("truth", type=Path, help="true skeletons, or those of another system")
    parser.add_argument("result", type=Path, help="skeletons of this detector, without a bias table")
    parser.add_argument("--out", type=Path, required=True, metavar="FILE", help="table (YAML) to write")
    parser.add_argument("--detector", default="", metavar="NAME", help="whose joints these are, for the file")
    parser.add_argument(
        "--leave-out", type=int, action="append", default=[], metavar="ID",
        help="do not measure on this person of the truth; repeatable",
    )  # fmt: skip


def run(args: argparse.Namespace) -> int:
    """Measure, write, and print what the table is worth for people whom it was not measured on."""
    with PassBar("biases") as bar:
        benefits = write_biases(
            args.truth, args.result, args.out, args.detector, args.leave_out, bar.show
        )
    print(_table(benefits) if benefits else "one person: nobody to judge on")
    return 0


def _table(benefits: Sequence[Benefit]) -> str:
    """Every person, judged with the offsets of all others."""
    lines = ["person, measured on the others    median mm   after    PCK 5 cm   after"]
    for b in benefits:
        lines.append(_row(str(b.person), b.median_before, b.median_after, b.pck_before, b.pck_after))
    names = ("median_before", "median_after", "pck_before", "pck_after")
    means = [float(np.mean([getattr(b, name) for b in benefits])) for name in names]
    lines.append(_row("mean of the people", *means))
    return "\n".join(lines)


def _row(name: str, *values: float) -> str:
    return "{:<32}{:>11.1f}{:>8.1f}{:>12.3f}{:>8.3f}".format(name, *values)
