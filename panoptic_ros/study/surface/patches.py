"""The study `patches`: processor time of every stage of surface motion, by number of views."""

from __future__ import annotations

import argparse
import time
from collections import Counter
from dataclasses import replace
from typing import Any

from panoptic_ros.domain import PatchTrajectories
from panoptic_ros.graph.build import configure
from panoptic_ros.graph.nodes import AFTER_DETECTION
from panoptic_ros.graph.pipeline import Pipeline
from panoptic_ros.running.arguments import within
from panoptic_ros.simulation import SKELETON, simulate
from panoptic_ros.simulation.rigs import Ring
from panoptic_ros.simulation.scenes import SCENES
from panoptic_ros.stage import Progress, StageContext
from panoptic_ros.study.child import run_child
from panoptic_ros.study.options import add_seeds, numbers
from panoptic_ros.study.study import Case, Column, Result, Row, Study
from panoptic_ros.study.world import instants_of

VIEWS = "4,6,8,16"
FEWEST = 20  # lower limit of frames
SCENE = "rendered-4p6v"
WARM = 8  # warm-up time steps that are ignored


class Patches(Study):
    """Every number of views is measured in a process of one thread."""

    columns = (
        Column("views", "views"),
        Column("people", "people"),
        Column("patches", "patches", ".0f"),
        Column("flow_ms", "flow ms", ".2f"),
        Column("patches_ms", "patches ms", ".2f"),
        Column("refinement_ms", "refinement ms", ".2f"),
        Column("refinement_without_ms", "(without)", ".2f"),
        Column("whole_ms", "all ms", ".2f"),
        Column("images_per_s", "images/s", ".1f"),
        Column("us_per_patch", "us per patch", ".1f"),
    )

    @classmethod
    def add_options(cls, parser: argparse.ArgumentParser) -> None:
        """See `Study`."""
        views = numbers(2, 480)
        parser.add_argument(
            "--views",
            type=views,
            default=views(VIEWS),
            help=f"numbers of VGA views in a ring; default {VIEWS}",
        )
        parser.add_argument(
            "--frames",
            type=within(int, FEWEST, 10**6),
            default=40,
            metavar="N",
            help="frames per number of views; default 40",
        )
        add_seeds(parser, "0")

    def cases(self) -> list[Case]:
        """See `Study`."""
        given = self.options
        return [
            Case(f"{views} views", {"views": views, "seed": seed, "frames": given.frames}, float(views))
            for views in given.views
            for seed in given.seeds
        ]

    def measure(self, case: Case, progress: Progress) -> list[Row]:
        """See `Study`."""
        row = run_child(measure_case, case.request)
        more = row["refinement_ms"] - row["refinement_without_ms"]
        whole = row["flow_ms"] + row["patches_ms"] + more
        per_patch = 1e3 * whole / max(row["patches"], 1.0)
        return [row | {"whole_ms": whole, "images_per_s": 1e3 / whole, "us_per_patch": per_patch}]

    def head(self, result: Result) -> str:
        """See `Study`."""
        return (
            "per instant, processor time of one thread; four people, rendered VGA images, simulated 2D people"
        )


def measure_case(request: dict[str, Any]) -> dict[str, Any]:
    """Return the processor time per time step of each stage of stage two, and the number of patches.

    Args:
        request: views, seed, frames.
    """
    rig = SCENES[SCENE].rig
    assert isinstance(rig, Ring)
    take = simulate(
        replace(SCENES[SCENE], rig=replace(rig, cameras=request["views"])), request["seed"], request["frames"]
    )
    instants = list(zip(instants_of(take, take.rig.names), take.detection_sets()))
    spent, patches = _spent(take.rig, instants, True)
    without, _ = _spent(take.rig, instants, False)
    return {
        "views": request["views"],
        "people": len(take.people),
        "patches": patches,
        "flow_ms": spent["flow"],
        "patches_ms": spent["patches"],
        "refinement_ms": spent["refinement"],
        "refinement_without_ms": without["refinement"],
    }


def _spent(rig: Any, instants: list[Any], active: bool) -> tuple[dict[str, float], float]:
    """Return the processor time (ms per time step) of each stage, and the mean number of patches."""
    spent: Counter[str] = Counter()
    counts: list[int] = []

    def gave(key: str, record: Any) -> None:
        if isinstance(record, PatchTrajectories):
            counts.append(len(record.ids))

    def used(stage: str, duration_ns: int) -> None:
        spent[stage] += duration_ns

    pipeline = Pipeline(
        configure({"patches": {"active": active}}),
        StageContext(rig, SKELETON),
        ("flow", *AFTER_DETECTION),
        on_record=gave,
        on_cpu=used,
        cpu_clock=time.thread_time_ns,
    )
    for number, (frames, views) in enumerate(instants):
        if number == WARM:
            spent.clear()
            counts.clear()
        for frame in frames if active else ():
            pipeline.push("image", frame)
        for view in views.views:
            pipeline.push("detections", view)
    counted = len(instants) - WARM
    stages = {stage: 1e-6 * ns / counted for stage, ns in spent.items()}
    pipeline.flush()
    return stages, sum(counts) / max(len(counts), 1)
