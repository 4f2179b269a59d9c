"""The bench `solve`: all stages from 2D people to skeletons, one thread: time of each, joints far off."""

from __future__ import annotations

import argparse
from typing import Any

from panoptic_ros.bench.ablation.variants import split
from panoptic_ros.bench.ablation.worlds import frames_of
from panoptic_ros.bench.child import run_child
from panoptic_ros.errors import UsageError
from panoptic_ros.stage import Progress, each, untold

CASE = "panoptic_ros.bench.solve_case"
SCENES = "three-views-2p,clean-4p5v,sitting-group-6p5v,noisy-8p5v,noisy-8p10v,noisy-8p31v"
STAGES = ("association", "voting", "assembly", "tracking", "refinement")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the bench."""
    parser.add_argument(
        "--scenes",
        default=SCENES,
        metavar="NAME,NAME",
        help=f"of `panoptic simulate`, none that is rendered; empty = none; default {SCENES}",
    )
    parser.add_argument("--seeds", default="0:1", metavar="FROM:TO", help="takes of each scene; default 0:1")
    parser.add_argument("--frames", type=int, metavar="N", help="of each scene at most")
    parser.add_argument(
        "--capture",
        nargs="+",
        action="append",
        default=[],
        metavar="PATH",
        dest="captures",
        help="a recording with its truth, as for `bench ablation`. May be given several times",
    )


def measure(args: argparse.Namespace, progress: Progress = untold) -> dict[str, Any]:
    """Every case in a process of one thread.

    Raises:
        UsageError: on scenes that are not there or rendered, and seeds that are none.
        UserError: if a recording cannot be read.
        EnvironmentProblem: if a case fails.
    """
    requests = _requests(args)
    rows = [
        {"case": title} | run_child(CASE, request)
        for title, request in each(requests, len(requests), progress, "cases")
    ]
    return {"bench": "solve", "threads": 1, "rows": rows}


def _requests(args: argparse.Namespace) -> list[tuple[str, dict[str, Any]]]:
    try:
        first, last = (int(part) for part in args.seeds.split(":"))
    except ValueError:
        raise UsageError(f"--seeds {args.seeds}: write FROM:TO, e.g. 0:3") from None
    found: list[tuple[str, dict[str, Any]]] = []
    for name in filter(None, args.scenes.split(",")):
        if split(name)[0].rendered:
            raise UsageError(f"{name} is rendered; `bench ablation` and `bench detection` take such scenes")
        for seed in range(first, last):
            request = {"scene": name, "seed": seed, "frames": frames_of(name, args.frames)}
            found.append((f"{name} {seed}", request))
    found += [(" ".join(paths), {"paths": paths}) for paths in args.captures]
    if not found:
        raise UsageError("there is nothing to solve: give --scenes or --capture")
    return found


def lines(result: dict[str, Any]) -> list[str]:
    """The table."""
    width = max(len(row["case"]) for row in result["rows"])
    head = "".join(f"{stage:>12}" for stage in STAGES)
    head += "   all   MPJPE mm  recall %  > 10 cm  of joints  id switches"
    text = [f"{'ms per set':<{width}} views{head}"]
    for row in result["rows"]:
        steps = "".join(f"{row['stages_ms'].get(stage, 0.0):12.2f}" for stage in STAGES)
        text.append(
            f"{row['case']:<{width}} {row['views']:5}{steps} {row['whole_ms']:5.2f} {row['mpjpe_mm']:10.2f} "
            f"{row['recall']:9.2f} {row['far']:8} {row['joints']:10} {row['id_switches']:12.0f}"
        )
    far, joints = (sum(row[key] for row in result["rows"]) for key in ("far", "joints"))
    text.append(
        f"processor time of one thread, medians of the quickest of three passes; "
        f"{far} of {joints} joints are off by more than 10 cm"
    )
    return text
