"""The study `continuous-time`: processor time and memory of continuous time, by the length of a recording.

Each length is measured in a process of its own, on one core.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from panoptic_ros.continuous.config import ContinuousConfig, ContinuousStageConfig
from panoptic_ros.continuous.passes import ContinuousPass
from panoptic_ros.continuous.stage import ContinuousStage
from panoptic_ros.domain import ViewDetections
from panoptic_ros.graph.build import configure
from panoptic_ros.graph.recording import InMemoryRecording
from panoptic_ros.io.messages import bag_messages, to_message
from panoptic_ros.params import config_of
from panoptic_ros.running.arguments import within
from panoptic_ros.simulation.free_running import simulate_free_running
from panoptic_ros.simulation.free_running_scenes import FREE_RUNNING_SCENES
from panoptic_ros.simulation.skeleton import SKELETON
from panoptic_ros.stage import Progress, StageContext, each, untold
from panoptic_ros.study.child import run_child
from panoptic_ros.study.options import add_seeds
from panoptic_ros.study.stopwatch import timed
from panoptic_ros.study.study import Case, Column, Result, Row, Study, table

Array = np.ndarray
SCENE = "staggered"  # two people before eight cameras of 12.5 Hz
WARM_S = 2.0  # s of a capture that loads the compiled kernels
LAG_S, ONLINE_HZ = 0.1, 50.0  # lag and rate of the online form
OUTPUT_HZ = 100.0  # rate of the output of the pass
ASK_EVERY = 10  # views from one requested instant to the next
SECOND = 1_000_000_000


class ContinuousTime(Study):
    """Cost per person-second of the pass and of the online form, their memory, and the time of an answer."""

    columns = (
        Column("seconds", "length s", ".0f"),
        Column("pass_share", "pass", ".3f"),
        Column("output_share", "output", ".3f"),
        Column("peak_mb", "peak MB", ".0f"),
        Column("online_share", "online", ".3f"),
        Column("state_kb", "state kB", ".0f"),
        Column("answer_ms", "answer ms", ".1f"),
        Column("answer_p99_ms", "99 %", ".1f"),
        Column("learning_ms", "learning ms", ".1f"),
    )

    @classmethod
    def add_options(cls, parser: argparse.ArgumentParser) -> None:
        """See `Study`."""
        parser.add_argument(
            "--seconds",
            type=within(float, 2.0, 600.0),
            default=60.0,
            metavar="S",
            help="length of the short recording; default 60",
        )
        parser.add_argument(
            "--times",
            type=within(int, 1, 100),
            default=10,
            metavar="N",
            help="length of the long recording in lengths of the short one; default 10",
        )
        add_seeds(parser, "1")

    def cases(self) -> list[Case]:
        """See `Study`."""
        short = self.options.seconds
        return [
            Case(f"{seconds:g} s, seed {seed}", (seconds, seed), seconds)
            for seed in self.options.seeds
            for seconds in dict.fromkeys((short, short * self.options.times))
        ]

    def measure(self, case: Case, progress: Progress) -> Iterator[Row]:
        """See `Study`."""
        seconds, seed = case.request
        requests = [{"seconds": seconds, "seed": seed}]
        for request in each(requests, 1, progress, "measuring"):
            yield request | run_child(measure_length, request)

    def summary(self, rows: list[Row]) -> dict[str, Any]:
        """See `Study`."""
        short = [row for row in rows if row["seconds"] == self.options.seconds]
        others = [row for row in rows if row["seconds"] != self.options.seconds] or short
        ratios = [b["pass_s"] / a["pass_s"] / self.options.times for a, b in zip(short, others)]
        return {"growth": float(np.mean(ratios)) if others is not short else np.nan}

    def head(self, result: Result) -> str:
        """See `Study`."""
        return (
            "Two people before eight cameras of 12.5 Hz, on one core. `pass`, `output`, `online`: processor "
            "seconds per person-second\n"
            f"of `panoptic continuous`, of its {OUTPUT_HZ:g} Hz output before writing, and of the stage with "
            f"lag {LAG_S:g} s at {ONLINE_HZ:g} Hz.\n"
            "`peak`: growth of the process during the pass. `state`: of the stage at the end. `answer`: from "
            "the last view that a request\n"
            "waited for to its message. `learning`: work between views, by which an answer may be later."
        )

    def lines(self, result: Result) -> Iterator[str]:
        """See `Study`."""
        yield from (*self.head(result).splitlines(), "", *table(result["rows"], self.columns))
        if np.isfinite(result["growth"]):
            yield (
                f"{self.options.times} times the length costs {self.options.times * result['growth']:.1f} "
                "times the processor time"
            )


def measure_length(request: dict[str, Any]) -> dict[str, Any]:
    """Measure one length of a recording, for `run_child`.

    Args:
        request: `seconds` and `seed`.
    """
    scene = FREE_RUNNING_SCENES[SCENE]
    for seconds in (WARM_S, request["seconds"]):
        capture = simulate_free_running(replace(scene, seconds=seconds), request["seed"])
        sets = list(capture.sets())
        recording = InMemoryRecording({"detection_sets": sets})
        context = StageContext(capture.rig, SKELETON)
        solver = ContinuousPass(ContinuousConfig(), context)
        calls = partial(solver.run, progress=untold)
        (motion,), solving = timed(calls, [recording], np.inf, warmed=True)
        begin = time.process_time()
        for _ in motion.sets(motion.at_rate(OUTPUT_HZ)):
            pass
        output = time.process_time() - begin
        online = _online([view for item in sets for view in item.views], context)
    times = np.arange(int(request["seconds"] * OUTPUT_HZ)) / OUTPUT_HZ
    people = float(capture.present(times).sum()) / OUTPUT_HZ  # person-seconds
    pass_s = 1e-3 * solving.cpu_ms_median
    return {
        "pass_s": pass_s,
        "pass_share": pass_s / people,
        "output_share": output / people,
        "peak_mb": solving.peak_mb,
        "online_share": online.pop("cpu_s") / people,
        **online,
    }


def _online(views: list[ViewDetections], context: StageContext) -> dict[str, float]:
    """Return the figures of the stage on views in the order of their timestamps."""
    config = configure({"continuous": {"active": True, "rate_hz": ONLINE_HZ, "lag": LAG_S}})
    stage = ContinuousStage(config_of(config, ContinuousStageConfig), context)
    cpu, answering, answers, learning = 0.0, 0.0, [], []
    requested: list[int] = []  # stamps that wait for the next view

    def look() -> None:
        nonlocal answering
        since = time.process_time()
        if requested and stage.has_all_of(requested[0]):
            stamp = requested.pop()
            if stamp in stage.instants():
                to_message(stage.at(stamp), bag_messages())
                answers.append(1e3 * (time.process_time() - begin))
        answering += time.process_time() - since

    stage.before_output(look)
    for k, view in enumerate(views):
        requested = [view.stamp_ns - round(LAG_S * SECOND) - 1] if k % ASK_EVERY == 0 else []
        begin = time.process_time()
        stage.step(view)
        look()  # as the service does
        cpu += time.process_time() - begin
        begin = time.process_time()
        stage.settle()
        learning.append(1e3 * (time.process_time() - begin))
        cpu += 1e-3 * learning[-1]
    worked = [ms for ms in learning if ms > 0.1 * max(learning)]
    return {
        "cpu_s": cpu - answering,
        "state_kb": 1e-3 * len(stage.state()),
        "answer_ms": float(np.median(answers)),
        "answer_p99_ms": float(np.percentile(answers, 99)),
        "learning_ms": float(np.median(worked)),
    }
