"""The study `live`: cameras to skeletons in real time, with recordings played as cameras."""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Iterator
from contextlib import closing

from panoptic_ros.capture import demo_capture, open_capture_folder
from panoptic_ros.running.arguments import within
from panoptic_ros.running.plans.free_threads import free_threads
from panoptic_ros.running.plans.options import RunOptions
from panoptic_ros.running.plans.parameters import live_parameters, read_parameters, with_defaults
from panoptic_ros.running.plans.plan import Plan
from panoptic_ros.stage import Progress
from panoptic_ros.study.options import add_capture, add_settings
from panoptic_ros.study.study import Case, Column, Result, Row, Study


class LiveStudy(Study):
    """Recordings are played as cameras to a live graph of its own."""

    columns = (
        Column("sent", "instants of the cameras", ".0f"),
        Column("received", "  skeletons received", ".0f"),
        Column("lost", "  lost", ".0f"),
        Column("rate_out_hz", "instants per second", ".1f"),
        Column("people", "people in each, mean", ".2f"),
        Column("latency_p50_ms", "latency p50, ms", ".0f"),
        Column("latency_p90_ms", "  p90", ".0f"),
        Column("latency_p99_ms", "  p99", ".0f"),
        Column("latency_max_ms", "  most", ".0f"),
        Column("cpu_percent", "processor time, % of a core", ".0f"),
        Column("first_skeletons_s", "first skeletons after, s", ".1f"),
        Column("resident_mb", "memory, MB", ".0f"),
    )
    across = True

    @classmethod
    def add_options(cls, parser: argparse.ArgumentParser) -> None:
        """See `Study`."""
        add_capture(parser, "capture folder with videos, or demo")
        parser.add_argument(
            "--rate",
            type=within(float, 1.0, 240.0),
            default=20.0,
            metavar="HZ",
            help="frame rate of the playback; default 20",
        )
        seconds = within(float, 1.0, 3600.0)
        parser.add_argument(
            "--seconds", type=seconds, default=20.0, metavar="S", help="measured time; default 20"
        )
        parser.add_argument(
            "--settle",
            type=within(float, 0.0, 600.0),
            default=5.0,
            metavar="S",
            help="playback before the measured time; default 5",
        )
        add_settings(parser, "one parameter, e.g. detection.budget=0.8")

    def measure(self, case: Case, progress: Progress) -> list[Row]:
        """See `Study`."""
        from panoptic_ros.study.live.played_graph import run_played_graph  # needs ROS

        given = self.options
        plan = _plan(given)
        found = run_played_graph(plan, given.seconds, given.settle)
        return [
            {
                "source": f"{plan.title}, {len(plan.rig)} cameras, {given.rate:g} Hz for {given.seconds:g} s",
                "cores": free_threads(1),
                "load": os.getloadavg()[0],
                "rate_out_hz": found["received"] / given.seconds,
                **found,
            }
        ]

    def head(self, result: Result) -> str:
        """See `Study`."""
        row = result["rows"][0]
        return f"{row['source']}; {row['cores']} cores, load {row['load']:.1f} after"

    def lines(self, result: Result) -> Iterator[str]:
        """See `Study`."""
        yield from super().lines(result)
        (row,) = result["rows"]
        yield "processor time per instant, ms"
        yield from (f"  {name:<30}{ms:>10.2f}" for name, ms in row["cpu_ms"].items())
        yield from (f"  {cause:<30}{count:>10}" for cause, count in row["dropped"].items())
        yield from (f"{code}: {text}" for code, text in row["chosen"].items())


def _plan(args: argparse.Namespace) -> Plan:
    folder = demo_capture() if str(args.capture) == "demo" else args.capture
    with closing(open_capture_folder(folder, cameras=args.cameras or None)) as capture:
        rig = capture.rig
    options = RunOptions(read_parameters(None, args.settings))
    skeleton, extras = options.detector()
    start = time.time_ns()
    return options.complete(
        Plan(
            str(args.capture),
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
