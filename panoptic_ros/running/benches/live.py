"""`panoptic bench live`: cameras to skeletons in real time, with recordings played as cameras."""

from __future__ import annotations

import argparse
import os
import time
from contextlib import closing
from pathlib import Path
from typing import Any

from panoptic_ros.capture import demo_capture, open_capture_folder
from panoptic_ros.errors import UsageError
from panoptic_ros.running.plans.free_threads import free_threads
from panoptic_ros.running.plans.options import RunOptions
from panoptic_ros.running.plans.parameters import live_parameters, read_parameters, with_defaults
from panoptic_ros.running.plans.plan import Plan
from panoptic_ros.stage import Progress, untold

ABOUT = "cameras to skeletons live, recordings being played as cameras: what is lost, latency, processor time"
ROWS = (
    ("instants of the cameras", "sent", 0),
    ("  skeletons received", "received", 0),
    ("  lost", "lost", 0),
    ("instants per second", "rate_out_hz", 1),
    ("people in each, mean", "people", 2),
    ("latency p50, ms", "latency_p50_ms", 0),
    ("  p90", "latency_p90_ms", 0),
    ("  p99", "latency_p99_ms", 0),
    ("  most", "latency_max_ms", 0),
    ("processor time, % of a core", "cpu_percent", 0),
    ("first skeletons after, s", "first_skeletons_s", 1),
    ("memory, MB", "resident_mb", 0),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the bench."""
    parser.add_argument("capture", metavar="CAPTURE_DIR", help="a capture folder with videos, or demo")
    parser.add_argument("--rate", type=float, default=20.0, metavar="HZ", help="of the cameras; default 20")
    parser.add_argument("--seconds", type=float, default=20.0, metavar="S", help="that count; default 20")
    parser.add_argument("--settle", type=float, default=5.0, metavar="S", help="before; default 5")
    parser.add_argument("--cameras", metavar="A,B", help="only these")
    parser.add_argument(
        "--set", action="append", default=[], metavar="STAGE.NAME=VALUE", help="e.g. detection.budget=0.8"
    )


def measure(args: argparse.Namespace, progress: Progress = untold) -> dict[str, Any]:
    """Play the cameras to a live graph of its own.

    Raises:
        UsageError: on numbers that make no sense.
        UserError: if the capture cannot be read, or as a node printed it, if one ended.
        EnvironmentProblem: if another graph runs in this ROS domain, or this one gives nothing.
    """
    from panoptic_ros.running.benches.played_graph import run_played_graph  # needs ROS

    if not 1.0 <= args.rate <= 240.0 or not 1.0 <= args.seconds <= 3600.0 or args.settle < 0.0:
        raise UsageError(f"{args.rate:g} Hz for {args.seconds:g} s: give 1 to 240 Hz and 1 to 3600 s")
    plan = _plan(args)
    found = run_played_graph(plan, args.seconds, args.settle)
    return {
        "bench": "live",
        "source": plan.title,
        "cameras": len(plan.rig),
        "rate_hz": args.rate,
        "seconds": args.seconds,
        "cores": free_threads(1),
        "load": os.getloadavg()[0],
        "rate_out_hz": found["received"] / args.seconds,
        **found,
    }


def lines(result: dict[str, Any]) -> list[str]:
    """The table."""
    out = [
        f"{result['source']}, {result['cameras']} cameras at {result['rate_hz']:g} Hz for "
        f"{result['seconds']:g} s; {result['cores']} cores, load {result['load']:.1f} after",
        "",
    ]
    for title, key, digits in ROWS:
        value = result[key]
        out.append(f"{title:<32}" + (f"{'-':>10}" if value is None else f"{value:>10.{digits}f}"))
    out.append("processor time per instant, ms")
    out += [f"{'  ' + name:<32}{ms:>10.2f}" for name, ms in result["cpu_ms"].items()]
    out += [f"{'  ' + cause:<32}{count:>10}" for cause, count in result["dropped"].items()]
    return out + [f"{code}: {text}" for code, text in result["chosen"].items()]


def _plan(args: argparse.Namespace) -> Plan:
    folder = demo_capture() if args.capture == "demo" else Path(args.capture)
    names = args.cameras.split(",") if args.cameras else None
    with closing(open_capture_folder(folder, cameras=names)) as capture:
        rig = capture.rig
    options = RunOptions(read_parameters(None, args.set))
    skeleton, extras = options.detector()
    start = time.time_ns()
    return options.complete(
        Plan(
            args.capture,
            rig,
            skeleton,
            with_defaults(options.all_parameters(), live_parameters(args.rate, len(rig))),
            {
                name: {"kind": "played", "path": str(folder), "rate_hz": args.rate, "start_ns": start}
                for name in rig.names
            },
            extras=extras,
            frame_rate=args.rate,
            live=True,
        )
    )
