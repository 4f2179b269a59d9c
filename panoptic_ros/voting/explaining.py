"""Explaining away: nodes where people are known, and what their joints leave of the scores of all views."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.domain import AssociationSet, SkeletonModel
from panoptic_ros.solving.evidence import RigArrays
from panoptic_ros.solving.joint_records import Candidates
from panoptic_ros.solving.joints import solve_joints
from panoptic_ros.solving.scene import Cameras, Observations, even_precision
from panoptic_ros.solving.triangulation import SolverRules
from panoptic_ros.voting.peaks import ImagePeaks, unexplained_peaks
from panoptic_ros.voting.proposals import Nodes, no_nodes
from panoptic_ros.voting.scene import VoteScene

Array = np.ndarray

NOISE = 0.005  # standard deviation of a 2D joint, as a share of the image's diagonal
# no joint is taken from another 2D person
RULES = SolverRules(truncation=4.0, cauchy=2.0, gate=4.0, foreign_penalty=16.0, max_pairs=15)


def rough_people(
    item: AssociationSet, arrays: RigArrays, skeleton: SkeletonModel
) -> tuple[Array, Array]:
    """Robust first estimate of joints (P, J, 3) m, NaN = unknown, and their velocities (P, J, 3) m/s.

    Each is where most views of the associated people support it, at least two.
    """
    evidence, rows = item.evidence, item.evidence.cameras
    precision = even_precision(evidence, arrays, NOISE)
    cams = Cameras(arrays.rotations[rows], arrays.translations[rows], evidence.delays)
    seen = Observations(evidence.plane, precision, evidence.view, evidence.starts, cams)
    found = Candidates.of(item, np.array(skeleton.mirror, np.int64))
    positions = solve_joints(found, seen, RULES).positions
    for joint, parts in skeleton.derived:
        positions[:, joint] = positions[:, list(parts)].mean(axis=1)
    return positions, found.guide.shifts


class Explainer(NamedTuple):
    """What is known: nodes, their velocities (N, 3) m/s, and when each view was taken, (V,) s from then."""

    nodes: Nodes
    velocities: Array
    delays: Array

    @classmethod
    def of_nobody(cls, delays: Array) -> Explainer:
        """Nothing is known."""
        return cls(no_nodes(), np.zeros((0, 3)), delays)

    def rows(self, which: Array) -> Explainer:
        """With some of the nodes only."""
        return Explainer(self.nodes.rows(which), self.velocities[which], self.delays)

    def unexplained(self, scene: VoteScene, peaks: ImagePeaks) -> ImagePeaks:
        """The 2D peaks without those near to where a node of their kind is seen."""
        left = unexplained_peaks(scene, peaks, self)
        return ImagePeaks(np.concatenate([[0], np.cumsum(left)])[peaks.start], peaks.pixels[left])
