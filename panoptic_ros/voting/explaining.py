"""Explaining away: nodes where people are known, and what their joints leave of the scores of all views."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.solving.rough_joints import RoughPeople
from panoptic_ros.voting import explain_kernels, kernels, soft_vote
from panoptic_ros.voting.image_peaks import ImagePeaks
from panoptic_ros.voting.proposals import Nodes, distinct
from panoptic_ros.voting.scene import VoteScene

Array = np.ndarray
SPACING = 0.12  # m, of the seeds of a joint that are followed
PROMISE = 0.9  # a seed is followed if its vote is above this, relative to what a node needs


def nodes_of_people(scene: VoteScene, people: RoughPeople, view_threshold: float) -> Nodes:
    """A node for each known joint, moved to the centre of the votes about it."""
    which = np.isfinite(people.positions[..., 0])
    joints = np.nonzero(which)[1]
    return _moved(scene, joints, people.positions[which], view_threshold)


def nodes_of_seeds(
    scene: VoteScene, joints: Array, points: Array, threshold: float, view_threshold: float
) -> Nodes:
    """Nodes at seeds of joints (S,) and points (S, 3) m, moved to the centre of the votes about them.

    Of seeds of one joint that are close to each other only that with most votes is followed.
    """
    if not len(joints):
        return Nodes(points, joints, np.zeros(0), joints)
    votes, _ = kernels.vote_points(scene, joints, points, 1.0)
    good = votes > PROMISE * threshold
    joints, points, votes = joints[good], points[good], votes[good]
    first = distinct(points, joints, votes, SPACING)
    nodes = _moved(scene, joints[first], points[first], view_threshold)
    return nodes.rows(distinct(nodes.points, nodes.joints, nodes.votes, SPACING))


def _moved(scene: VoteScene, joints: Array, points: Array, view_threshold: float) -> Nodes:
    points = soft_vote.move(points, joints, scene)
    votes, support = kernels.vote_points(scene, joints, points, view_threshold)
    return Nodes(points, joints, votes, support)


class Explainer(NamedTuple):
    """What is known: nodes, their velocities (N, 3) m/s, and when each view was taken, (V,) s from then."""

    nodes: Nodes
    velocities: Array
    delays: Array

    def unexplained(self, scene: VoteScene, peaks: ImagePeaks) -> ImagePeaks:
        """The 2D peaks without those near to where a node of their kind is seen."""
        left = explain_kernels.unexplained_peaks(scene, peaks, self)
        return ImagePeaks(np.concatenate([[0], np.cumsum(left)])[peaks.start], peaks.pixels[left])
