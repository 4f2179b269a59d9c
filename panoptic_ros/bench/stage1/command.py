"""The bench `stage1`: which cases there are, each measured in a fresh process of one thread."""

from __future__ import annotations

import argparse
import platform
from pathlib import Path
from typing import Any

from panoptic_ros.bench.child import run_child
from panoptic_ros.bench.growth import exponent
from panoptic_ros.errors import UsageError
from panoptic_ros.stage import Progress, untold

CASE = "panoptic_ros.bench.stage1.case"
ALL = ("people", "maps", "voting", "baselines")
DENSE_VIEWS, DENSE_VIEWS_QUICK = 31, 5  # up to so many views the dense voter takes part
MANY_PEOPLE = 7


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the bench."""
    numbers: dict[str, Any] = {"type": _numbers, "metavar": "N,N"}
    parser.add_argument("--people", default=(1, 4, 8), help="default 1,4,8", **numbers)
    parser.add_argument("--views", default=(3, 5, 10, 31), help="default 3,5,10,31", **numbers)
    parser.add_argument(
        "--many-views",
        default=(96, 480),
        **numbers,
        help="rigs of VGA cameras with smaller maps, without dense voting; default 96,480; 0 = none",
    )
    parser.add_argument(
        "--skeletons",
        default="panoptic15,panoptic19,body25,blazepose33,wholebody133",
        metavar="NAME,NAME",
        help="models for the growth with joints, at 4 people and 5 views; empty = none",
    )
    parser.add_argument("--frames", type=int, default=60, metavar="N", help="per case; default 60")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of the simulation")
    parser.add_argument("--quick", action="store_true", help="fewer cases and frames, within a minute")
    parser.add_argument(
        "--aniposelib", metavar="PYTHON", help="interpreter of an environment that has aniposelib, to compare"
    )
    bag = parser.add_argument_group("a recording in place of the simulation")
    bag.add_argument("--bag", type=Path, metavar="DIR", help="a bag that `panoptic run` wrote")
    bag.add_argument("--cameras", metavar="NAME,NAME", help="only these")
    bag.add_argument(
        "--skeleton", metavar="NAME", help="in the joints of this model, e.g. coco17; default: as recorded"
    )
    bag.add_argument("--truth", type=Path, metavar="FILE", help="true skeletons")
    bag.add_argument(
        "--volume", type=float, nargs=6, metavar="M", help="to search: least x y z, largest x y z, m"
    )


def measure(args: argparse.Namespace, progress: Progress = untold) -> dict[str, Any]:
    """All cases and the growth.

    Raises:
        UsageError: on cases that make no sense.
        UserError: if a recording cannot be read.
        EnvironmentProblem: if a case fails.
    """
    if min((*args.people, *args.views), default=0) < 1 or args.frames < 2:
        raise UsageError("people and views must be at least 1, and frames at least 2")
    requests = _recorded(args) if args.bag else _simulated(args)
    cases = []
    for number, request in enumerate(requests):
        progress(number / len(requests), _name(request))
        cases.append({"request": request} | run_child(CASE, request))
    progress(1.0, "done")
    return {
        "bench": "stage1",
        "machine": platform.processor() or platform.machine(),
        "threads": 1,
        "cases": cases,
        "growth": growth(cases),
    }


def _simulated(args: argparse.Namespace) -> list[dict[str, Any]]:
    quick = args.quick
    common = {
        "frames": min(args.frames, 25) if quick else args.frames,
        "seed": args.seed,
        "budget_s": 0.15 if quick else 0.5,
        "aniposelib": args.aniposelib,
    }
    dense_views = DENSE_VIEWS_QUICK if quick else DENSE_VIEWS
    people = (4,) if quick and args.people == (1, 4, 8) else args.people
    views = (5, 10) if quick and args.views == (3, 5, 10, 31) else args.views
    requests = [
        common
        | {
            "kind": "grid",
            "people": p,
            "views": v,
            "parts": [*ALL, *(["dense"] if v <= dense_views and not (quick and v > 5) else [])],
        }
        for p in people
        for v in views
    ]
    for v in () if quick else [v for v in args.many_views if v]:
        requests.append(
            common | {"kind": "many", "people": MANY_PEOPLE, "views": v, "frames": 8, "parts": list(ALL[:3])}
        )
    names = [name for name in args.skeletons.split(",") if name]
    for name in names[-1:] if quick else names:
        parts = ["people", "maps", "voting"]
        requests.append(
            common | {"kind": "joints", "people": 4, "views": 5, "skeleton": name, "parts": parts}
        )
    return requests


def _recorded(args: argparse.Namespace) -> list[dict[str, Any]]:
    return [
        {
            "kind": "bag",
            "bag": str(args.bag),
            "cameras": args.cameras.split(",") if args.cameras else None,
            "skeleton": args.skeleton,
            "truth": str(args.truth) if args.truth else None,
            "volume": args.volume,
            "frames": args.frames,
            "budget_s": 0.2 if args.quick else 1.0,
            "parts": [*ALL, *([] if args.quick else ["dense"])],
        }
    ]


def growth(cases: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Exponents of the median time of every method in views, people and joints, all else equal."""
    found = []
    grid = [case for case in cases if case["request"]["kind"] == "grid"]
    most = {key: max((case["request"][key] for case in grid), default=0) for key in ("people", "views")}
    middle = sorted({case["request"]["views"] for case in grid})
    fixed_views = middle[len(middle) // 2] if middle else 0
    series = {
        "views": [c for c in grid if c["request"]["people"] == most["people"]],
        "people": [c for c in grid if c["request"]["views"] == fixed_views],
        "joints": [c for c in cases if c["request"]["kind"] == "joints"],
    }
    where = {
        "views": f"{most['people']} people",
        "people": f"{fixed_views} views",
        "joints": "4 people, 5 views",
    }
    for what, members in series.items():
        times: dict[tuple[str, str], list[tuple[int, float]]] = {}
        for case in members:
            size = case["joints"] if what == "joints" else case["request"][what]
            for row in case["rows"]:
                if row.get("calls"):
                    times.setdefault((row["step"], row["method"]), []).append((size, row["cpu_ms_median"]))
        for (step, method), points in times.items():
            power = exponent(*zip(*points))
            if power is not None:
                found.append(
                    {
                        "in": what,
                        "at": where[what],
                        "step": step,
                        "method": method,
                        "exponent": power,
                        "points": [list(point) for point in points],
                    }
                )
    return found


def _name(request: dict[str, Any]) -> str:
    if request["kind"] == "bag":
        return str(request["bag"])
    return f"{request['people']} people, {request['views']} views {request.get('skeleton', '')}".strip()


def _numbers(text: str) -> tuple[int, ...]:
    try:
        return tuple(int(word) for word in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is no list of whole numbers, e.g. 1,4,8") from None
