"""`panoptic bias measure TRUTH RESULT --out FILE`: the constant biases of a detector's joints."""
from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from panoptic_ros.cli.evaluate import read_sequence
from panoptic_ros.cli.evaluate_joints import spelt_alike
from panoptic_ros.errors import DataError, UsageError
from panoptic_ros.evaluation import pair_sequences
from panoptic_ros.evaluation.bias import Benefit, leave_one_out, matched_people, measure_offsets
from panoptic_ros.io.biases import torso_of, write_bias_table
from panoptic_ros.io.skeletons import in_vocabulary

Array = np.ndarray


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
    truth, result = read_sequence(args.truth), read_sequence(args.result)
    people = matched_people(pair_sequences(truth, spelt_alike(result, truth)))
    names = sorted(set(people.ids.tolist()))
    if not names:
        raise DataError(f"nobody in {args.result} is near anybody in {args.truth}")
    for person in args.leave_out:
        if person not in names:
            raise UsageError(f"--leave-out {person}: the ids found are {', '.join(map(str, names))}")
    kept = people.rows(~np.isin(people.ids, args.leave_out))
    if not len(kept.ids):
        raise UsageError("--leave-out leaves nobody to measure on")
    torso, words = torso_of(truth.joint_names, str(args.truth)), in_vocabulary(truth.joint_names)
    mirror = np.array([_other_side(word, words) for word in words])
    offsets = measure_offsets(kept, torso, mirror)
    rows = {w: o for w, o in zip(words, offsets) if not w.startswith("right_") and np.isfinite(o).all()}
    if not rows:
        raise DataError(f"nobody in {args.result} shows both shoulders and both hips")
    basis = f"{len(kept.ids)} skeletons of {len(set(kept.ids.tolist()))} people"
    facts = {"detector": args.detector, "measured_on": basis}
    write_bias_table(args.out, rows, facts)
    several = len(names) > 1
    print(_table(leave_one_out(people, torso, mirror)) if several else "one person: nobody to judge on")
    return 0


def _other_side(word: str, words: tuple[str, ...]) -> int:
    """Index of the joint on the other side; its own in the middle or where there is none."""
    for one, other in (("left_", "right_"), ("right_", "left_")):
        if word.startswith(one) and other + word.removeprefix(one) in words:
            return words.index(other + word.removeprefix(one))
    return words.index(word)


def _table(benefits: list[Benefit]) -> str:
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
