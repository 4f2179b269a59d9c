"""Scores of rig studies: PCK over all joints of all persons, and the accuracy of nodes and skeletons."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from panoptic_ros.evaluation.joint_scores import ratio
from panoptic_ros.evaluation.pairing import FramePair

Array = np.ndarray
THRESHOLDS = np.linspace(0.0, 0.10, 101)  # m, of the PCK curve
OUTLIER = 0.05  # m, a node with a larger error is an outlier; about the radius of a limb


@dataclass(frozen=True)
class StudyScore:
    """Accuracy of one set of cameras.

    Args:
        skeletons: Number of true skeletons in all frames.
        nodes: Number of their joints.
        outlier_nodes: Number of nodes with an error above `outlier_m`.
        missed_nodes: Number of true joints without a node.
        ghosts: Number of skeletons in the result without a true person.
        node_accuracy: Share of the nodes that are neither outliers nor missed (Table 3 counts both).
        skeleton_accuracy: Share of the skeletons without any such node.
        median_mm: Median error of the nodes that were found, mm.
        pck: Share of all nodes within each of `THRESHOLDS`.
        outlier_m: Error (m) above which a node is an outlier.
    """

    skeletons: int
    nodes: int
    outlier_nodes: int
    missed_nodes: int
    ghosts: int
    node_accuracy: float
    skeleton_accuracy: float
    median_mm: float
    pck: tuple[float, ...]
    outlier_m: float = OUTLIER

    def to_mapping(self) -> dict[str, Any]:
        """Return the fields and the thresholds as a mapping for JSON."""
        return asdict(self) | {"pck_thresholds_m": THRESHOLDS.round(4).tolist()}


def score_study(pairs: Sequence[FramePair], joints: Sequence[int], outlier_m: float = OUTLIER) -> StudyScore:
    """Score matched frames on some of the joints.

    Args:
        joints: column indices of the joints.
        outlier_m: error (m) above which a node is an outlier.
    """
    columns = list(joints)
    rows = [np.zeros((0, len(columns)))]
    ghosts = 0
    for pair in pairs:
        errors = np.full((len(pair.truth), pair.truth.shape[1]), np.inf)
        errors[pair.matches[:, 0]] = np.where(np.isnan(pair.distances), np.inf, pair.distances)
        rows.append(errors[:, columns])
        ghosts += len(pair.result) - len(pair.matches)
    errors = np.concatenate(rows)
    there = np.isfinite(errors)
    right = errors <= outlier_m
    curve = [ratio(int((errors <= limit).sum()), errors.size) for limit in THRESHOLDS]
    return StudyScore(
        skeletons=len(errors),
        nodes=errors.size,
        outlier_nodes=int((there & ~right).sum()),
        missed_nodes=int((~there).sum()),
        ghosts=ghosts,
        node_accuracy=ratio(int(right.sum()), errors.size),
        skeleton_accuracy=ratio(int(right.all(axis=1).sum()), len(errors)),
        median_mm=1e3 * float(np.median(errors[there])) if there.any() else float("nan"),
        pck=tuple(curve),
        outlier_m=outlier_m,
    )
