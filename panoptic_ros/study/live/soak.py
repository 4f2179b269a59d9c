"""The study `soak`: a long live run in which cameras and processes fail at random."""

from __future__ import annotations

import argparse
import os

from panoptic_ros.running.arguments import within
from panoptic_ros.stage import Progress
from panoptic_ros.study.live.graph_feed import simulated_feed
from panoptic_ros.study.study import Case, Result, Row, Study

SCENARIO = "noisy-8p5v"


class Soak(Study):
    """A long live run in which cameras and processes fail at random moments."""

    @classmethod
    def add_options(cls, parser: argparse.ArgumentParser) -> None:
        """See `Study`."""
        for name, low, high, default, unit, text in (
            ("--minutes", 0.2, 3000.0, 3.0, "M", "duration of the run"),
            ("--rate", 1.0, 240.0, 30.0, "HZ", "rate of the cameras"),
            ("--kill-every", 10.0, 1e6, 20.0, "S", "mean time between two kills of a process"),
            ("--away-every", 0.1, 1e6, 8.0, "S", "mean time between two failures of a camera"),
        ):
            parser.add_argument(
                name,
                type=within(float, low, high),
                default=default,
                metavar=unit,
                help=f"{text}; default {default:g}",
            )
        parser.add_argument(
            "--hosts",
            choices=("one", "stage"),
            default="stage",
            help="all stages in one process (one), or a process per stage (stage, default)",
        )
        for name in ("--people", "--views"):
            parser.add_argument(
                name, type=within(int, 1, 480), metavar="N", help=f"number, instead of that of {SCENARIO}"
            )

    def measure(self, case: Case, progress: Progress) -> list[Row]:
        """See `Study`."""
        from panoptic_ros.study.live.failures import run_soak  # needs ROS

        given = self.options
        feed = simulated_feed(SCENARIO, given.people, given.views, given.rate)
        found = run_soak(
            feed,
            60.0 * given.minutes,
            given.hosts == "stage",
            given.kill_every,
            given.away_every,
            progress,
        )
        return [
            {
                "source": feed.title,
                "views": len(feed.rig),
                "rate_hz": feed.rate,
                "minutes": given.minutes,
                "hosts": given.hosts,
                "cores": os.cpu_count(),
                "load": os.getloadavg()[0],
                **found,
            }
        ]

    def lines(self, result: Result) -> list[str]:
        """See `Study`."""
        (result,) = result["rows"]
        out = [
            f"{result['source']}, {result['views']} views at {result['rate_hz']:g} Hz for "
            f"{result['minutes']:g} minutes, {result['failures']} failures; "
            f"{result['cores']} cores, load {result['load']:.1f}",
            f"identities: {result['kept']} of {result['people']} kept, {result['identities']} in all",
            f"instants without skeletons: {result['lost']} of {result['instants']}",
        ]
        out += [f"  {cause}: {count}" for cause, count in result["lost_by_cause"].items()]
        out.append("nodes counted, over their restarts:")
        out += [f"  {cause}: {count}" for cause, count in result["dropped"].items()]
        memory = result["memory_mb"]
        told = " ".join(f"{value:.0f}" for value in memory)
        return [*out, f"memory of all processes, MB: {told}; second half {result['growth_mb']:+.1f}"]
