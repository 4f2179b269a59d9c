"""Position errors of joints, and shares of found joints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from panoptic_ros.evaluation.pairing import FramePair

Array = np.ndarray

HIT = 0.10  # m; a joint within this distance counts for recall and precision
PCK_THRESHOLDS = (0.02, 0.05, 0.10, 0.15)  # m; error thresholds of PCK
NAN = float("nan")


@dataclass(frozen=True, slots=True)
class JointScore:
    """Scores of one joint over all matches; errors in mm."""

    name: str
    mean_mm: float
    median_mm: float
    p90_mm: float
    recall: float  # share of all truth joints of this name that are within HIT


@dataclass(frozen=True, slots=True)
class JointScores:
    """Position errors over all matched joints, and recall and precision over all joints.

    Args:
        mpjpe_mm, median_mm: Mean and median distance over all joints of all matches.
        pck: (threshold in m, share of the truth joints of matched people that are closer). A missing joint
            is treated as wrong.
        pck_of_everybody: `pck` over all truth people. All joints of unmatched people are treated as wrong.
        recall, precision: Joints within `HIT`, as shares of all truth joints and of all result joints.
    """

    mpjpe_mm: float
    median_mm: float
    pck: tuple[tuple[float, float], ...]
    pck_of_everybody: tuple[tuple[float, float], ...]
    recall: float
    precision: float
    by_joint: tuple[JointScore, ...]


def ratio(part: float, whole: float) -> float:
    """Return part / whole, NaN if the whole is 0."""
    return float(part / whole) if whole else NAN


def matched_distances(pairs: Sequence[FramePair], joints: int) -> Array:
    """Return distances (M, J) m of all matches of all frames, NaN where a joint is missing."""
    return np.concatenate([np.empty((0, joints)), *(pair.distances for pair in pairs)])


def pck_curve(pairs: Sequence[FramePair], joints: int, thresholds: Array, everybody: bool = False) -> Array:
    """Return PCK (N,) at thresholds (N,) m, over the joints of matched people or of all truth people."""
    distances = matched_distances(pairs, joints)
    errors = np.sort(distances[~np.isnan(distances)])
    whole = sum(_count(pair.truth if everybody else pair.truth[pair.matches[:, 0]]) for pair in pairs)
    closer = np.searchsorted(errors, thresholds, side="left")
    return closer / whole if whole else np.full(len(thresholds), NAN)


def score_joints(pairs: Sequence[FramePair], joint_names: Sequence[str]) -> JointScores:
    """Return position errors, PCK, recall and precision of all joints."""
    distances = matched_distances(pairs, len(joint_names))
    errors = distances[~np.isnan(distances)]
    hits = int((errors < HIT).sum())
    found, everybody = (
        pck_curve(pairs, len(joint_names), np.array(PCK_THRESHOLDS), everybody) for everybody in (False, True)
    )
    there = np.concatenate(
        [np.empty((0, len(joint_names)), bool), *(~np.isnan(pair.truth[..., 0]) for pair in pairs)]
    ).sum(axis=0)
    return JointScores(
        mpjpe_mm=1e3 * float(errors.mean()) if errors.size else NAN,
        median_mm=1e3 * float(np.median(errors)) if errors.size else NAN,
        pck=tuple(zip(PCK_THRESHOLDS, found.tolist())),
        pck_of_everybody=tuple(zip(PCK_THRESHOLDS, everybody.tolist())),
        recall=ratio(hits, int(there.sum())),
        precision=ratio(hits, sum(_count(pair.result) for pair in pairs)),
        by_joint=tuple(
            _score_joint(name, column[~np.isnan(column)], int(count))
            for name, column, count in zip(joint_names, distances.T, there)
        ),
    )


def _score_joint(name: str, errors: Array, truth_count: int) -> JointScore:
    if not errors.size:
        return JointScore(name, NAN, NAN, NAN, ratio(0, truth_count))
    median, p90 = np.percentile(1e3 * errors, [50, 90])
    hits = int((errors < HIT).sum())
    return JointScore(name, 1e3 * float(errors.mean()), float(median), float(p90), ratio(hits, truth_count))


def _count(positions: Array) -> int:
    """Return the number of joints (..., 3) that are not missing."""
    return int((~np.isnan(positions[..., 0])).sum())
