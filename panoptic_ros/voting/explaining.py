"""Explaining away: nodes where people are known, and what their joints leave of the scores of all views."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.domain.of_all import selected
from panoptic_ros.voting.peaks import ImagePeaks, unexplained_peaks
from panoptic_ros.voting.proposals import Nodes, no_nodes
from panoptic_ros.voting.scene import VoteScene

Array = np.ndarray


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
        return Explainer(selected(self.nodes, which), self.velocities[which], self.delays)

    def unexplained(self, scene: VoteScene, peaks: ImagePeaks) -> ImagePeaks:
        """The 2D peaks without those near to where a node of their kind is seen."""
        left = unexplained_peaks(scene, peaks, self)
        return ImagePeaks(np.concatenate([[0], np.cumsum(left)])[peaks.start], peaks.pixels[left])
