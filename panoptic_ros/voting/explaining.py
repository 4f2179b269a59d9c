"""Explaining away: nodes where people are known, and what their joints leave of the scores of all views."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.consensus.rough_people import RoughPeople
from panoptic_ros.voting import explain_kernels, kernels, soft_vote
from panoptic_ros.voting.scene import VoteScene

Array = np.ndarray


class Nodes(NamedTuple):
    """Node proposals: points (N, 3) m, joints (N,), votes (N,), supporting views (N,)."""

    points: Array
    joints: Array
    votes: Array
    support: Array

    def rows(self, which: Array) -> Nodes:
        """Some of them."""
        return Nodes(*(values[which] for values in self))

    def joined(self, other: Nodes) -> Nodes:
        """These and the others."""
        return Nodes(*(np.concatenate(pair) for pair in zip(self, other)))


def nodes_of_people(scene: VoteScene, people: RoughPeople, view_threshold: float) -> Nodes:
    """A node for each known joint, moved to the centre of the votes about it."""
    which = np.isfinite(people.positions[..., 0])
    joints = np.nonzero(which)[1]
    points = soft_vote.move(people.positions[which], joints, scene)
    votes, support = kernels.vote_points(scene, joints, points, view_threshold)
    return Nodes(points, joints, votes, support)


class Explainer(NamedTuple):
    """What is known: nodes, their velocities (N, 3) m/s, and when each view was taken, (V,) s from then."""

    nodes: Nodes
    velocities: Array
    delays: Array

    def unexplained(self, scene: VoteScene, start: Array, pixels: Array) -> tuple[Array, Array]:
        """The 2D peaks of `find_peaks` without those near to where a node of their kind is seen."""
        left = explain_kernels.unexplained_peaks(
            scene, start, pixels, self.nodes.joints, self.nodes.points, self.velocities, self.delays
        )
        return np.concatenate([[0], np.cumsum(left)])[start], pixels[left]
