"""The study `graph`: the live graph after detection, fed with 2D poses at their frame rate."""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from panoptic_ros.errors import UsageError
from panoptic_ros.graph.nodes import FUSION
from panoptic_ros.running.arguments import within
from panoptic_ros.stage import Progress
from panoptic_ros.study.live.graph_feed import recorded_feed, simulated_feed
from panoptic_ros.study.study import Case, Column, Result, Row, Study

SCENARIO = "noisy-8p5v"
HOSTS = {"one": "one process", "stage": "a process per stage"}


class Graph(Study):
    """The graph runs once for each choice of processes, on the same data."""

    columns = (
        Column("title", ""),
        Column("sent", "instants sent", ".0f"),
        Column("received", "  skeletons received", ".0f"),
        Column("lost", "  lost", ".0f"),
        Column("latency_p50_ms", "latency p50, ms", ".1f"),
        Column("latency_p90_ms", "  p90", ".1f"),
        Column("latency_p99_ms", "  p99", ".1f"),
        Column("latency_max_ms", "  most", ".1f"),
        Column("cpu_percent", "processor time, % of a core", ".1f"),
        Column("first_skeletons_s", "first skeletons after, s", ".1f"),
        Column("resident_mb", "memory, MB", ".0f"),
        Column("growth_mb", "  growth, MB", ".1f"),
        *(Column(f"{stage}_ms", f"{stage}, step p50, ms", ".2f") for stage in FUSION),
    )
    across = True

    @classmethod
    def add_options(cls, parser: argparse.ArgumentParser) -> None:
        """See `Study`."""
        add_load(parser)
        parser.add_argument(
            "--hosts",
            choices=(*HOSTS, "both"),
            default="both",
            help="all stages in one process (one), a process per stage (stage), or one after the other "
            "(default)",
        )
        parser.add_argument(
            "--scenario", default=SCENARIO, metavar="NAME", help=f"simulated scenario; default {SCENARIO}"
        )
        parser.add_argument(
            "--kill", action="store_true", help="then kill each process, and measure whether it recovers"
        )
        parser.add_argument(
            "--flood",
            type=float,
            nargs="?",
            const=10.0,
            default=0.0,
            metavar="S",
            help="then send invalid messages on every topic, for S seconds each; default 10 (42: 100,000 "
            "messages)",
        )
        parser.add_argument(
            "--bag", type=Path, metavar="DIR", help="use the 2D people of a bag instead of simulated ones"
        )

    def cases(self) -> list[Case]:
        """See `Study`."""
        given = self.options
        if given.bag and (given.people or given.views):
            raise UsageError("--people and --views are of a simulation; leave them out with --bag")
        return [Case(HOSTS[name], name) for name in (HOSTS if given.hosts == "both" else [given.hosts])]

    def measure(self, case: Case, progress: Progress) -> list[Row]:
        """See `Study`."""
        from panoptic_ros.study.live.fed_graph import run_fed_graph  # needs ROS

        given = self.options
        if given.bag:
            feed = recorded_feed(given.bag, given.rate)
        else:
            feed = simulated_feed(given.scenario, given.people, given.views, given.rate)
        about = {
            "title": case.title,
            "source": f"{feed.title}, {len(feed.rig)} views at {feed.rate:g} Hz for {given.seconds:g} s",
            "cores": os.cpu_count(),
            "load": os.getloadavg()[0],
        }
        found = run_fed_graph(feed, given.seconds, case.request == "stage", given.kill, given.flood)
        return [about | found | {f"{stage}_ms": ms for stage, ms in found["steps_ms"].items()}]

    def head(self, result: Result) -> str:
        """See `Study`."""
        row = result["rows"][0]
        return f"{row['source']}; {row['cores']} cores, load {row['load']:.1f} before"

    def lines(self, result: Result) -> Iterator[str]:
        """See `Study`."""
        yield from super().lines(result)
        for row in result["rows"]:
            yield from map(_restart_line, row["restarts"])
            yield from map(_flood_line, row["floods"])
            told = ", ".join(f"{cause} {count}" for cause, count in row["dropped"].items())
            if told:
                yield f"{row['title']}: dropped since the start: {told}"


def add_rate(parser: argparse.ArgumentParser) -> None:
    """Add the option for the rate of simulated cameras."""
    parser.add_argument(
        "--rate",
        type=within(float, 1.0, 240.0),
        default=30.0,
        metavar="HZ",
        help="rate of the cameras; default 30",
    )


def add_load(parser: argparse.ArgumentParser, seconds: float = 20.0) -> None:
    """Add the options for the load of a live graph."""
    add_rate(parser)
    parser.add_argument(
        "--seconds",
        type=within(float, 1.0, 3600.0),
        default=seconds,
        metavar="S",
        help=f"measured time, after the graph has settled; default {seconds:g}",
    )
    for name in ("--people", "--views"):
        parser.add_argument(
            name, type=within(int, 1, 480), metavar="N", help="number, instead of the scenario's own"
        )


def _restart_line(restart: dict[str, Any]) -> str:
    silence = restart["silence_s"]
    came = "no skeletons came back" if silence is None else f"skeletons after {silence:.2f} s"
    return f"{restart['process']} killed: {came}, {restart['kept']} of {restart['people']} identities kept"


def _flood_line(flood: dict[str, Any]) -> str:
    return (
        f"{flood['title']} ({flood['messages']} in all): {flood['lost']} of {flood['instants']} instants "
        f"lost, longest gap {flood['longest_gap_s']:.2f} s, {flood['odd_stamps']} odd stamps"
    )
