"""Figures of one solution: the quality of its skeletons, and their processor time."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from panoptic_ros.domain import RefinedPoseSet
from panoptic_ros.evaluation import FramePair, SkeletonFrame, SkeletonSequence, pair_sequences
from panoptic_ros.evaluation.joint_scores import HIT, matched_distances
from panoptic_ros.evaluation.report import report_of
from panoptic_ros.graph.build import configure
from panoptic_ros.graph.nodes import FUSION
from panoptic_ros.graph.pipeline import Pipeline
from panoptic_ros.io.compared_skeletons import spelt_alike
from panoptic_ros.stage import StageContext
from panoptic_ros.study.world import World

Array = np.ndarray
WITHIN = 95.0  # nominal percentage of joints inside their 95 % covariance ellipsoids


@dataclass(frozen=True)
class Figure:
    """One column of the table.

    Args:
        worse: sign of a change for the worse; 0 = no quality figure.
        digits: decimals in the table.
    """

    key: str
    title: str
    worse: int
    digits: int


FIGURES = (
    Figure("mpjpe_mm", "MPJPE mm", +1, 2),
    Figure("recall", "recall %", -1, 2),
    Figure("precision", "precision %", -1, 2),
    Figure("far_per_1000", f"> {100 * HIT:.0f} cm /1000", +1, 2),
    Figure("id_switches", "id switches", +1, 2),
    Figure("acceleration_error", "acc. m/s^2", +1, 2),
    Figure("misfit_95", "misfit of 95 %", +1, 2),
    Figure("ms_per_frame", "ms / frame", 0, 2),
)


@dataclass(frozen=True)
class Solution:
    """Skeletons of a world and their processor time.

    Args:
        skeletons: skeletons of all sets.
        steps_ms: (F,) ms of this thread for every set, by stage.
    """

    skeletons: SkeletonSequence
    steps_ms: dict[str, Array]

    @property
    def spent_ms(self) -> Array:
        """Return the time (F,) ms of this thread for every set, summed over the stages."""
        return np.asarray(np.sum(list(self.steps_ms.values()), axis=0))


def solve(world: World, settings: dict[str, dict[str, Any]]) -> Solution:
    """Return the refined skeletons of a world, from its 2D poses."""
    frames: list[SkeletonFrame] = []
    spent: dict[str, list[int]] = {}

    def take(topic: str, record: Any) -> None:
        if topic == "skeletons":
            frames.append(_frame(record))

    pipeline = Pipeline(
        configure(settings),
        StageContext(world.rig, world.skeleton),
        FUSION,
        on_record=take,
        on_step=lambda stage, ns: spent.setdefault(stage, []).append(ns),
        clock=time.thread_time_ns,
    )
    for item in world.sets:
        pipeline.push("detection_sets", item)
    pipeline.flush()
    steps = {stage: 1e-6 * np.array(times[: len(world.sets)]) for stage, times in spent.items()}
    return Solution(SkeletonSequence(world.names, tuple(frames)), steps)


def figures_of(truth: SkeletonSequence, solution: Solution, stretches: int = 1) -> list[dict[str, float]]:
    """Return the figures by key for each of `stretches` equal parts of the frames; NaN where undefined."""
    pairs = pair_sequences(truth, spelt_alike(solution.skeletons, truth))
    cuts = np.array_split(np.arange(len(pairs)), stretches)
    times = np.array_split(solution.spent_ms, stretches)
    return [
        _figures([pairs[k] for k in cut], truth.joint_names, float(np.median(spent)))
        for cut, spent in zip(cuts, times)
    ]


def _figures(pairs: list[FramePair], joint_names: Sequence[str], ms_per_frame: float) -> dict[str, float]:
    report = report_of(pairs, joint_names)
    errors = matched_distances(pairs, len(joint_names))
    errors, told = errors[np.isfinite(errors)], report.consistency
    return {
        "mpjpe_mm": report.joints.mpjpe_mm,
        "recall": 100.0 * report.joints.recall,
        "precision": 100.0 * report.joints.precision,
        "far_per_1000": 1e3 * float((errors >= HIT).mean()) if errors.size else math.nan,
        "id_switches": float(report.identities.switches - report.identities.switches_over_gaps),
        "acceleration_error": report.acceleration_error,
        "misfit_95": math.nan if told is None else abs(100.0 * told.cover95 - WITHIN),
        "ms_per_frame": ms_per_frame,
    }


def _frame(poses: RefinedPoseSet) -> SkeletonFrame:
    return SkeletonFrame(poses.stamp_ns, poses.ids, poses.positions, poses.covariances)
