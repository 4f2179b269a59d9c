"""Explaining away: nodes where people are known, and what their joints leave of the scores of all views."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.voting import explain_kernels, kernels, soft_vote
from panoptic_ros.voting.image_peaks import ImagePeaks
from panoptic_ros.voting.proposals import Nodes, no_nodes
from panoptic_ros.voting.scene import VoteScene
from panoptic_ros.voting.soft_kernels import Moving

Array = np.ndarray


def moved(
    scene: VoteScene, joints: Array, points: Array, view_threshold: float, moving: Moving | None = None
) -> Nodes:
    """Nodes of joints (N,) at the centres of the votes about points (N, 3) m, at the points' instant."""
    moving = moving or soft_vote.at_rest(points, scene)
    points = soft_vote.move(points, joints, scene, moving=moving)
    votes, support = kernels.vote_moving(scene, joints, points, moving, view_threshold)
    return Nodes(points, joints, votes, support)


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
        left = explain_kernels.unexplained_peaks(scene, peaks, self)
        return ImagePeaks(np.concatenate([[0], np.cumsum(left)])[peaks.start], peaks.pixels[left])
