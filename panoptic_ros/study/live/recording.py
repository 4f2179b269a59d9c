"""The study `recording`: memory of a live run that records, with its time compressed."""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

from panoptic_ros.domain import RefinedPoseSet
from panoptic_ros.graph.build import configure
from panoptic_ros.graph.nodes import FUSION
from panoptic_ros.graph.pipeline import records_of
from panoptic_ros.running.arguments import within
from panoptic_ros.running.plans.plan import Plan
from panoptic_ros.running.processes.usage import usage_of
from panoptic_ros.running.runs.results import Results
from panoptic_ros.stage import Progress, StageContext
from panoptic_ros.study.live.graph import add_rate
from panoptic_ros.study.live.graph_feed import simulated_feed
from panoptic_ros.study.study import Case, Column, Result, Row, Study

SCENARIO = "noisy-8p5v"
LOOKS = 10  # memory measurements per run
BEGIN_NS = 1_700_000_000_000_000_000


class RecorderMemory(Study):
    """A live run's recorder gets the data of so many minutes as fast as it takes them.

    Each row has the memory after a part of the data.
    """

    columns = (Column("minutes", "minutes", ".1f"), Column("resident_mb", "memory, MB", ".1f"))

    @classmethod
    def add_options(cls, parser: argparse.ArgumentParser) -> None:
        """See `Study`."""
        parser.add_argument(
            "--minutes",
            type=within(float, 0.1, 6000.0),
            default=10.0,
            metavar="M",
            help="simulated duration of the run; default 10",
        )
        add_rate(parser)
        for name, default, text in (("--people", 3, "people"), ("--views", 4, "views")):
            parser.add_argument(
                name,
                type=within(int, 1, 480),
                default=default,
                metavar="N",
                help=f"number of {text}; default {default}",
            )

    def measure(self, case: Case, progress: Progress) -> list[Row]:
        """See `Study`."""
        given = self.options
        feed = simulated_feed(SCENARIO, given.people, given.views, given.rate)
        configs = configure({"refinement": {"lag": 0.0}})
        poses: list[RefinedPoseSet] = records_of(
            "skeletons", feed.sets, configs, StageContext(feed.rig, feed.skeleton), FUSION
        )
        count = round(60.0 * given.minutes * given.rate)
        plan = Plan("bench", feed.rig, feed.skeleton, configs, stage="sync", frame_rate=feed.rate, live=True)
        rows, begun = [], time.monotonic()
        with tempfile.TemporaryDirectory(prefix="panoptic-bench-") as folder:
            with Results(Path(folder), plan) as results:
                for number in range(count):
                    stamp = BEGIN_NS + number * feed.period_ns
                    for offset, view in feed.views(feed.number_of_set(number)):
                        results.take(
                            "detections", replace(view, stamp_ns=stamp + offset, frame_number=number)
                        )
                    pose = poses[min(feed.number_of_set(number), len(poses) - 1)]
                    results.take("skeletons", replace(pose, stamp_ns=stamp, index=number))
                    if (number + 1) % max(1, count // LOOKS) == 0:
                        rows.append(_row(number + 1, feed.rate))
                        progress((number + 1) / count, "records are taken")
            size_mb = 1e-6 * sum(path.stat().st_size for path in Path(folder).rglob("*") if path.is_file())
        self.about = {
            "source": f"{given.people} people in {len(feed.rig)} views at {feed.rate:g} Hz",
            "seconds": time.monotonic() - begun,
            "written_mb": size_mb,
        }
        return rows

    def summary(self, rows: list[Row]) -> dict[str, Any]:
        """See `Study`."""
        half = rows[len(rows) // 2 - 1 :]
        minutes = half[-1]["minutes"] - half[0]["minutes"]
        growth = (half[-1]["resident_mb"] - half[0]["resident_mb"]) / max(1e-9, minutes) * 60.0
        return self.about | {"mb_per_hour": growth}

    def head(self, result: Result) -> str:
        """See `Study`."""
        return (
            f"a live run that records {result['source']}; {result['seconds']:.0f} s, "
            f"{result['written_mb']:.0f} MB written; growth in the second half: "
            f"{result['mb_per_hour']:.0f} MB an hour"
        )


def _row(number: int, rate: float) -> dict[str, float]:
    return {"minutes": number / rate / 60.0, "resident_mb": usage_of([os.getpid()]).resident_mb}
