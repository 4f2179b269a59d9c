"""Report with all scores of one result."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from panoptic_ros.errors import DataError
from panoptic_ros.evaluation.identity_scores import (
    IdentityScores,
    PersonScores,
    score_identities,
    score_people,
)
from panoptic_ros.evaluation.joint_scores import JointScores, score_joints
from panoptic_ros.evaluation.motion_scores import Consistency, acceleration_error, score_consistency
from panoptic_ros.evaluation.pairing import FramePair, pair_sequences
from panoptic_ros.evaluation.sequences import SkeletonSequence


@dataclass(frozen=True, slots=True)
class Report:
    """All scores of `evaluate`; each part documents its definitions."""

    frames: int  # number of truth frames that count
    paired_frames: int  # number of these with a result
    mean_offset_ms: float  # timestamp of the result minus that of the truth
    largest_offset_ms: float
    joints: JointScores
    people: PersonScores
    identities: IdentityScores
    acceleration_error: float  # m/s^2
    consistency: Consistency | None  # None: no covariances were reported

    def to_mapping(self) -> dict[str, Any]:
        """Return the scores under their names in `--json`, with None for undefined values (NaN)."""
        joints, people, identities = self.joints, self.people, self.identities
        scores: dict[str, Any] = _plain(
            {
                "frames": self.frames,
                "paired_frames": self.paired_frames,
                "stamp_offset_ms": {"mean": self.mean_offset_ms, "max_abs": self.largest_offset_ms},
                "mpjpe_mm": joints.mpjpe_mm,
                "median_mm": joints.median_mm,
                "pck": {f"{threshold:.2f}": share for threshold, share in joints.pck},
                "pck_of_everybody": {
                    f"{threshold:.2f}": share for threshold, share in joints.pck_of_everybody
                },
                "joint_recall": joints.recall,
                "joint_precision": joints.precision,
                "median_by_joint_mm": {joint.name: joint.median_mm for joint in joints.by_joint},
                "mpjpe_by_joint_mm": {joint.name: joint.mean_mm for joint in joints.by_joint},
                "recall_by_joint": {joint.name: joint.recall for joint in joints.by_joint},
                "truth_persons": people.truth,
                "result_persons": people.result,
                "found_persons": people.found,
                "person_recall": people.recall,
                "person_precision": people.precision,
                "unmatched_per_frame": people.unmatched_per_frame,
                "id_switches": identities.switches,
                "id_switches_over_gaps": identities.switches_over_gaps,
                "same_ids": identities.same_ids,
                "fragments": identities.fragments,
                "mota": identities.mota,
                "idf1": identities.idf1,
                "acceleration_error": self.acceleration_error,
                "nees": None if self.consistency is None else asdict(self.consistency),
            }
        )
        return scores


def evaluate(truth: SkeletonSequence, result: SkeletonSequence, skip: int = 0) -> Report:
    """Compare a result with the truth; `skip` leaves out the first truth frames.

    Raises:
        DataError: If the truth is empty, or truth and result have no joint in common.
    """
    if not truth.frames:
        raise DataError("the truth has no frames")
    return report_of(pair_sequences(truth, result, skip), truth.joint_names)


def report_of(pairs: Sequence[FramePair], joint_names: Sequence[str]) -> Report:
    """Return the scores of frames that are already paired."""
    offsets = np.array([1e-6 * pair.offset_ns for pair in pairs if pair.offset_ns is not None])
    return Report(
        frames=len(pairs),
        paired_frames=len(offsets),
        mean_offset_ms=float(offsets.mean()) if offsets.size else math.nan,
        largest_offset_ms=float(np.abs(offsets).max()) if offsets.size else math.nan,
        joints=score_joints(pairs, joint_names),
        people=score_people(pairs),
        identities=score_identities(pairs),
        acceleration_error=acceleration_error(pairs),
        consistency=score_consistency(pairs),
    )


def _plain(value: Any) -> Any:
    """Return the value with NaN replaced by None, recursively."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    return None if isinstance(value, float) and math.isnan(value) else value
