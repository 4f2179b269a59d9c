"""The study `solve`: run all stages from 2D poses to skeletons on one thread.

It reports the time of each stage and the number of joints with a large error.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from typing import Any

import numpy as np

from panoptic_ros.errors import UsageError
from panoptic_ros.evaluation import pair_sequences
from panoptic_ros.evaluation.joint_scores import HIT, matched_distances
from panoptic_ros.io.compared_skeletons import spelt_alike
from panoptic_ros.running.arguments import within
from panoptic_ros.stage import Progress
from panoptic_ros.study.ablation.figures import figures_of, solve
from panoptic_ros.study.child import run_child
from panoptic_ros.study.options import add_recordings, add_seeds, recordings, words
from panoptic_ros.study.study import Case, Column, Result, Row, Study
from panoptic_ros.study.world import frames_of, recorded_world, simulated_world, split

SCENES = "three-views-2p,clean-4p5v,sitting-group-6p5v,noisy-8p5v,noisy-8p10v,noisy-8p31v"
STAGES = ("association", "voting", "assembly", "tracking", "refinement")
PASSES = 3  # the fastest pass counts, because other processes slow down the rest


class SolveStudy(Study):
    """Every case is solved in a process of one thread."""

    columns = (
        Column("case", "ms per set"),
        Column("views", "views"),
        *(Column(f"{stage}_ms", stage, ".2f") for stage in STAGES),
        Column("whole_ms", "all", ".2f"),
        Column("mpjpe_mm", "MPJPE mm", ".2f"),
        Column("recall", "recall %", ".2f"),
        Column("far", "> 10 cm"),
        Column("joints", "of joints"),
        Column("id_switches", "id switches", ".0f"),
    )

    @classmethod
    def add_options(cls, parser: argparse.ArgumentParser) -> None:
        """See `Study`."""
        parser.add_argument(
            "--scenes",
            type=words,
            default=words(SCENES),
            metavar="NAME,NAME",
            help=f"scenes of `panoptic simulate` that are not rendered; empty = none; default {SCENES}",
        )
        add_seeds(parser, "0:1")
        parser.add_argument(
            "--frames", type=within(int, 3, 10**6), metavar="N", help="greatest number of frames per scene"
        )
        add_recordings(parser)

    def cases(self) -> list[Case]:
        """See `Study`."""
        found = []
        for name in self.options.scenes:
            if split(name)[0].rendered:
                raise UsageError(
                    f"{name} is rendered; the studies `ablation` and `detection` take such scenes"
                )
            frames = frames_of(name, self.options.frames)
            for seed in self.options.seeds:
                found.append(Case(f"{name} {seed}", {"scene": name, "seed": seed, "frames": frames}))
        found += [Case(" ".join(paths), {"paths": paths}) for paths in recordings(self.options)]
        if not found:
            raise UsageError("there is nothing to solve: give --scenes or --capture")
        return found

    def measure(self, case: Case, progress: Progress) -> list[Row]:
        """See `Study`."""
        return [{"case": case.title} | run_child(measure_case, case.request)]

    def lines(self, result: Result) -> Iterable[str]:
        """See `Study`."""
        yield from super().lines(result)
        far, joints = (sum(row[key] for row in result["rows"]) for key in ("far", "joints"))
        yield (
            "processor time of one thread, medians of the quickest of three passes; "
            f"{far} of {joints} joints are off by more than 10 cm"
        )


def measure_case(request: dict[str, Any]) -> Row:
    """Return the median processor time per set of every stage, and the number of joints with a large error.

    Args:
        request: keys scene, seed and frames; or key paths of a recording.
    """
    if "paths" in request:
        world = recorded_world(request["paths"])
    else:
        world = simulated_world(request["scene"], request["seed"], request["frames"])
    truth = world.truth
    assert truth is not None  # true for all cases
    solve(world, {})  # warm up: the first run has cold caches
    passes = [solve(world, {}) for _ in range(PASSES)]
    best = min(passes, key=lambda solution: float(np.median(solution.spent_ms)))
    (figures,) = figures_of(truth, best)
    pairs = pair_sequences(truth, spelt_alike(best.skeletons, truth))
    errors = matched_distances(pairs, len(truth.joint_names))
    return {
        "frames": len(world.sets),
        "views": len(world.rig),
        **{f"{stage}_ms": float(np.median(times)) for stage, times in best.steps_ms.items()},
        "whole_ms": float(np.median(best.spent_ms)),
        "mpjpe_mm": figures["mpjpe_mm"],
        "recall": figures["recall"],
        "id_switches": figures["id_switches"],
        "joints": int(np.isfinite(errors).sum()),
        "far": int((errors >= HIT).sum()),
    }
