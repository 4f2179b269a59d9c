"""The bench `patches`: what the motion of the surface costs, by the number of views."""

from __future__ import annotations

import argparse
from typing import Any

from panoptic_ros.bench.child import run_child
from panoptic_ros.errors import UsageError
from panoptic_ros.stage import Progress, each, untold

CASE = "panoptic_ros.bench.patches_case"
VIEWS = "4,6,8,16"
FEWEST = 20  # frames


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the bench."""
    parser.add_argument("--views", default=VIEWS, metavar="N,N", help=f"VGA views in a ring; default {VIEWS}")
    parser.add_argument("--frames", type=int, default=40, metavar="N", help="of each; default 40")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of the scene")


def measure(args: argparse.Namespace, progress: Progress = untold) -> dict[str, Any]:
    """Every number of views in a process of one thread.

    Raises:
        UsageError: on numbers of views that are none, or too few frames.
        EnvironmentProblem: if a case fails.
    """
    try:
        views = [int(word) for word in args.views.split(",")]
    except ValueError:
        views = [0]
    if min(views) < 2:
        raise UsageError(f"--views {args.views}: write numbers from 2, e.g. {VIEWS}")
    if args.frames < FEWEST:
        raise UsageError(f"--frames {args.frames} is too few to measure; {FEWEST} at least")
    requests = [{"views": number, "seed": args.seed, "frames": args.frames} for number in views]
    rows = [run_child(CASE, request) for request in each(requests, len(requests), progress, "views")]
    return {"bench": "patches", "threads": 1, "rows": rows}


def lines(result: dict[str, Any]) -> list[str]:
    """The table."""
    text = [
        "ms per instant, processor time of one thread; four people, rendered VGA images, simulated 2D people",
        "views  people  patches    flow  patches  refinement (without)    all  images/s  us per patch",
    ]
    for row in result["rows"]:
        more = row["refinement_ms"] - row["refinement_without_ms"]
        whole = row["flow_ms"] + row["patches_ms"] + more
        text.append(
            f"{row['views']:5} {row['people']:7} {row['patches']:8.0f} {row['flow_ms']:7.2f} "
            f"{row['patches_ms']:8.2f} {row['refinement_ms']:11.2f} {row['refinement_without_ms']:9.2f} "
            f"{whole:6.2f} {1e3 / whole:9.1f} {1e3 * whole / max(row['patches'], 1.0):13.1f}"
        )
    return text
