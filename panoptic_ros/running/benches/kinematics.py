"""`panoptic bench kinematics`: processor time of bodies, per solve and per instant."""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterator
from typing import Any

from panoptic_ros.errors import UsageError
from panoptic_ros.stage import Progress

ABOUT = "bodies from cameras and IMUs: processor time per solve and per instant"
KINDS = ((8, 13), (4, 13), (4, 6), (1, 13), (8, 0), (0, 13))
LAGS = (0.0, 0.1)
SUBJECTS, RATE = 4, 60.0
MOST_LIVE, RATES = 8, (20, 30, 60)
LATE = "late"  # instants that the stage left out to catch up
BACK_S = 8.0  # after which the subjects of the live graph go back


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of this bench."""
    parser.add_argument("--seconds", type=float, default=6.0, metavar="S", help="of the capture (default 6)")
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="of the capture")
    parser.add_argument(
        "--live",
        type=int,
        nargs="?",
        const=SUBJECTS,
        default=0,
        metavar="N",
        help=f"in place of all this N subjects (default {SUBJECTS}) in the live graph, with 13 IMUs each, "
        "before 8 cameras: latency, and all of the nodes' work",
    )
    parser.add_argument("--rate", type=int, choices=RATES, default=30, help="live, of cameras; default 30")
    parser.add_argument("--lag", type=float, default=0.1, metavar="S", help="live, of bodies; default 0.1")


def measure(args: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    """Solve a simulated capture from several mixes of cameras and IMUs.

    Raises:
        UsageError: if there is no capture of so many seconds.
    """
    from panoptic_ros.running.benches.body_costs import body_costs  # numba is slow to load

    if not 2.0 <= args.seconds <= 20.0:
        raise UsageError(f"--seconds {args.seconds} is not 2 to 20")
    if args.live:
        return _live(args)
    rows = []
    for row in body_costs(args.seconds, args.seed, KINDS, LAGS):
        rows.append(row)
        progress(len(rows) / len(KINDS), f"{row['cameras']} cameras, {row['imus']} IMUs")
    worst = max(row[f"lag_{LAGS[-1]:g}_mean_ms"] for row in rows)
    return {"rows": rows, "share_of_core": 1e-3 * SUBJECTS * RATE * worst}


def _live(args: argparse.Namespace) -> dict[str, Any]:
    from panoptic_ros.bench.body_feed import body_feed
    from panoptic_ros.io.body_models import read_body_model
    from panoptic_ros.io.recorded_motions import read_clips
    from panoptic_ros.running.benches.fed_bodies import run_fed_bodies  # needs ROS

    if not 1 <= args.live <= MOST_LIVE or not 0.0 <= args.lag <= 0.2:
        said = f"--live {args.live}, --lag {args.lag}"
        raise UsageError(f"{said}: give 1 to {MOST_LIVE} subjects and 0 to 0.2 s")
    feed = body_feed(args.live, args.rate, BACK_S, args.seed, read_body_model(), read_clips())
    return {
        "source": feed.title,
        "views": len(feed.rig),
        "rate_hz": feed.rate,
        "lag_s": args.lag,
        "load": os.getloadavg()[0],
        **run_fed_bodies(feed, args.seconds, args.lag),
    }


def lines(result: dict[str, Any]) -> Iterator[str]:
    """The table, or what was seen live."""
    if "cpu_percent" in result:
        yield from _live_lines(result)
        return
    yield "processor time, ms: median (mean) per instant"
    yield "cameras IMUs   per solve  iterations      " + "      ".join(f"lag {lag:g} s" for lag in LAGS)
    for row in result["rows"]:
        steps = "  ".join(f"{row[f'lag_{g:g}_ms']:5.2f} ({row[f'lag_{g:g}_mean_ms']:.2f})" for g in LAGS)
        yield f"{row['cameras']:7} {row['imus']:4} {row['solve_ms']:11.3f} {row['iterations']:11.1f}  {steps}"
    share = 100.0 * result["share_of_core"]
    yield f"{SUBJECTS} subjects at {RATE:g} Hz, lag {LAGS[-1]:g} s, dearest of these: {share:.0f} % of a core"


def _live_lines(result: dict[str, Any]) -> Iterator[str]:
    yield (
        f"{result['source']}, {result['views']} cameras at {result['rate_hz']:g} Hz, "
        f"lag {result['lag_s']:g} s; load {result['load']:.1f} before"
    )
    lost = {cause: rate for cause, rate in result["dropped_hz"].items() if cause != LATE}
    causes = f" ({', '.join(f'{rate:.1f} {cause}' for cause, rate in lost.items())})" if lost else ""
    yield (
        f"{result['instants_hz']:.1f} instants/s with {result['bodies']:.2f} bodies solved from data; "
        f"{result['dropped_hz'].get(LATE, 0.0):.1f} instants/s left out as late; "
        f"{sum(lost.values()):.1f} messages/s dropped{causes}"
    )
    late = ", ".join(f"{_ms(result[f'latency_p{share}_ms'])} (p{share})" for share in (50, 90, 99, 100))
    least = 1e3 * (result["lag_s"] + 1.0 / result["rate_hz"])
    yield f"from an instant to its bodies, ms: {late}; lag and a camera's period are {least:.0f}"
    yield f"from a set of views to its skeletons, ms: {_ms(result['skeletons_p50_ms'])} (p50)"
    used = ", ".join(f"{name} {share:.0f}" for name, share in result["cpu_percent"].items())
    yield f"processor time by process, % of a core: {used}"


def _ms(value: float | None) -> str:
    return "-" if value is None else f"{value:.1f}"
