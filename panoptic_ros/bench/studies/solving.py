"""From detection sets to skeletons with stage one, and how good they are."""
from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from panoptic_ros.domain import DetectionSet, Rig, SkeletonModel
from panoptic_ros.evaluation import SkeletonFrame, SkeletonSequence, pair_sequences
from panoptic_ros.evaluation.studies import StudyScore, score_study
from panoptic_ros.graph.build import configure
from panoptic_ros.graph.pipeline import Pipeline
from panoptic_ros.stage import StageContext

SCORED = (
    "Neck", "Nose", "BodyCenter", "lShoulder", "lElbow", "lWrist", "lHip", "lKnee", "lAnkle",
    "rShoulder", "rElbow", "rWrist", "rHip", "rKnee", "rAnkle",
)  # fmt: skip
SETTLED = 2  # frames at the start that do not count: the noise of the detector is being learnt


def solve(
    rig: Rig, skeleton: SkeletonModel, sets: Iterable[DetectionSet], settings: dict[str, dict[str, Any]]
) -> SkeletonSequence:
    """The skeletons of the views of `rig`, of every instant by itself unless the settings say otherwise."""
    names = set(rig.names)
    frames: list[SkeletonFrame] = []

    def take(topic: str, record: Any) -> None:
        if topic == "poses":
            ids = np.arange(len(record.positions))
            frames.append(SkeletonFrame(record.stamp_ns, ids, record.positions, record.covariances))

    pipeline = Pipeline(
        configure(settings), StageContext(rig, skeleton), ("association", "voting", "assembly"),
        on_record=take,
    )
    for item in sets:
        seen = tuple(view for view in item.views if view.camera in names)
        pipeline.push("detection_sets", replace(item, views=seen))
    return SkeletonSequence(skeleton.joint_names, tuple(frames))


def score(truth: SkeletonSequence, result: SkeletonSequence) -> StudyScore:
    """The 15 joints of the paper, in all frames but the first ones."""
    skip = SETTLED if len(truth.frames) > 2 * SETTLED else 0
    pairs = pair_sequences(truth, result, skip)
    return score_study(pairs, [truth.joint_names.index(name) for name in SCORED])
