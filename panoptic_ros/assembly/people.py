"""From solved joints to skeletons that are people: covariances, checks, derived joints."""
from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from panoptic_ros.assembly.candidates import Candidates
from panoptic_ros.assembly.config import AssemblyConfig
from panoptic_ros.assembly.disputed import place_disputed
from panoptic_ros.assembly.judgement import (
    drop_long_bones,
    judge_joints,
    possible_people,
    second_skeletons,
)
from panoptic_ros.assembly.map_votes import chosen_nodes
from panoptic_ros.assembly.nodes import has_maps, node_doubts, take_nodes
from panoptic_ros.assembly.view_sources import view_sources
from panoptic_ros.domain import JointState, PoseSet, ProposalSet, SkeletonModel, TimeShift, ViewSources
from panoptic_ros.solving.joint_records import SolvedJoints
from panoptic_ros.solving.scene import Scene

Array = np.ndarray

MEASURED, MISSING = int(JointState.MEASURED), int(JointState.MISSING)  # members are slow to look up


@dataclass(frozen=True, slots=True, eq=False)
class People:
    """Skeletons of one instant: P people of the K solved.

    kept: (P,) which of the solved. positions (P, J, 3), covariances (P, J, 3, 3), scores (P, J),
    views (P, J). doubts: (P, J) m^2, additional variance because a node may be the wrong one. sources:
    their 2D people.
    """

    kept: Array
    positions: Array
    covariances: Array
    scores: Array
    views: Array
    doubts: Array
    sources: ViewSources

    def rows(self, which: Array) -> People:
        """Some of the people, by a mask (P,)."""
        return People(
            self.kept[which], self.positions[which], self.covariances[which], self.scores[which],
            self.views[which], self.doubts[which], self.sources.rows(np.flatnonzero(which)),
        )  # fmt: skip

    def pose_set(
        self, item: ProposalSet, votes: Array | None = None, shift: TimeShift | None = None
    ) -> PoseSet:
        """The record, with votes (P, G) about the sides of limbs."""
        measured = np.isfinite(self.positions[..., 0])
        states = np.where(measured, MEASURED, MISSING)
        newest = max((view.stamp_ns for view in item.detections.views), default=-1)
        person = self.scores.sum(axis=1) / np.maximum(measured.sum(axis=1), 1)
        covariances = self.covariances + self.doubts[..., None, None] * np.eye(3)
        return PoseSet(
            item.index, item.stamp_ns, item.detections.skeleton_hash, self.positions, covariances,
            self.scores, self.views, states, person, max(newest, item.stamp_ns), shift, self.sources, votes,
        )  # fmt: skip


def finish(
    scene: Scene, item: ProposalSet, solved: SolvedJoints, found: Candidates, observed: Array, shares: Array,
    skeleton: SkeletonModel, config: AssemblyConfig,
) -> People:  # fmt: skip
    """Covariances and scores, derived joints, and only those skeletons that can be people.

    Args:
        found: the people that were solved; where they expect joints, nodes are looked for.
        observed: (P, J) number of views whose 2D person shows each joint. shares: (P,) of the joints seen in
            two or more views, on which these must agree.
    """
    expected = found.guide.positions
    covariances, worst, scores, views = judge_joints(
        solved, scene.evidence.scores, observed, cauchy_correction(config.cauchy),
        config.covariance_inflation,
    )  # fmt: skip
    good = np.isfinite(covariances[..., 0, 0]) & (worst <= config.max_joint_sigma**2)
    drop_long_bones(solved.positions, worst, good, _bones(skeleton.bones), config.max_bone)
    positions = np.where(good[..., None], solved.positions, np.nan)
    covariances = np.where(good[..., None, None], covariances, np.nan)
    views, scores, doubts = np.where(good, views, 0), np.where(good, scores, 0.0), np.zeros(good.shape)
    if config.node_distance > 0.0 and has_maps(item):
        _use_nodes(item, expected, positions, covariances, scores, views, doubts, config)
    if config.vote_distance > 0.0 and len(item.nodes):
        _move_to_votes(item, expected, positions, covariances, scores, views, doubts, skeleton, config)
    place_disputed(
        scene, found.grouping, found.source, expected, positions, covariances, scores, views, skeleton
    )
    _derive(positions, covariances, scores, views, doubts, skeleton)
    lost = np.all(found.grouping.member < 0, axis=1)  # they have nodes and nothing else
    good |= lost[:, None] & np.isfinite(positions[..., 0])
    possible = possible_people(
        positions, good, observed, shares, config.min_person_joints, config.lowest
    )
    kept = np.flatnonzero(possible)
    kept = kept[~second_skeletons(positions[kept], views[kept])]
    sources = view_sources(item.detections, scene.evidence, found, solved, kept)
    return People(kept, positions[kept], covariances[kept], scores[kept], views[kept], doubts[kept], sources)


@cache
def cauchy_correction(scale: float) -> float:
    """Variance of the Cauchy estimate of a 2D Gaussian over the inverse of its mean weight.

    For psi(r) = r w(r), w = 1 / (1 + r^2 / scale^2), the variance is E[psi^2] / E[psi']^2 (Huber 1964),
    here per axis with r^2 chi-squared of two degrees of freedom.
    """
    squares = np.linspace(0.0, 60.0, 6001)[1:] - 0.005
    density = 0.5 * np.exp(-0.5 * squares) * 0.01
    weight = 1.0 / (1.0 + squares / scale**2)
    slope = weight - squares / scale**2 * weight**2  # mean over the axes of d psi / d r
    variance = (0.5 * squares * weight**2 * density).sum() / (slope * density).sum() ** 2
    return float(variance * (weight * density).sum())


@cache
def _bones(bones: tuple[tuple[int, int], ...]) -> Array:
    """Bones (B, 2) as an array."""
    return np.array(bones, np.int64).reshape(-1, 2)


def _use_nodes(
    item: ProposalSet, expected: Array, positions: Array, covariances: Array, scores: Array, views: Array,
    doubts: Array, config: AssemblyConfig,
) -> None:  # fmt: skip
    """Replace joints that are missing, or less certain than nodes, by voted nodes, in place."""
    missing = np.isnan(positions[..., 0])
    variance = np.trace(covariances, axis1=-2, axis2=-1) / 3.0
    with np.errstate(invalid="ignore"):
        weak = missing | ((views <= 2) & (variance > config.node_sigma**2))
    chosen = take_nodes(item, np.where(missing[..., None], expected, positions), weak, config.node_distance)
    p, j = np.nonzero(chosen >= 0)
    nodes = chosen[p, j]
    positions[p, j], covariances[p, j] = item.nodes[nodes], config.node_sigma**2 * np.eye(3)
    scores[p, j], views[p, j] = item.node_scores[nodes], item.node_views[nodes]
    doubts[p, j] = node_doubts(item.node_scores[nodes])


def _move_to_votes(
    item: ProposalSet, expected: Array, positions: Array, covariances: Array, scores: Array, views: Array,
    doubts: Array, skeleton: SkeletonModel, config: AssemblyConfig,
) -> None:  # fmt: skip
    """Move joints to the votes of the maps, in place; a joint that moves far takes all values of the node."""
    chosen = chosen_nodes(positions, expected, item, config.vote_distance, skeleton)
    p, j = np.nonzero(chosen >= 0)
    nodes = chosen[p, j]
    far = ~(np.linalg.norm(item.nodes[nodes] - positions[p, j], axis=-1) <= config.vote_distance)
    positions[p, j] = item.nodes[nodes]
    p, j, nodes = p[far], j[far], nodes[far]
    covariances[p, j] = config.node_sigma**2 * np.eye(3)
    scores[p, j], views[p, j] = item.node_scores[nodes], item.node_views[nodes]
    doubts[p, j] = node_doubts(item.node_scores[nodes])


def _derive(
    positions: Array, covariances: Array, scores: Array, views: Array, doubts: Array,
    skeleton: SkeletonModel,
) -> None:  # fmt: skip
    """Fill joints that are means of others, in place, with the covariance of the mean."""
    for joint, others in skeleton.derived:
        parts = list(others)
        positions[:, joint] = positions[:, parts].mean(axis=1)
        covariances[:, joint] = covariances[:, parts].sum(axis=1) / len(parts) ** 2
        doubts[:, joint] = doubts[:, parts].sum(axis=1) / len(parts) ** 2
        there = np.isfinite(positions[:, joint, 0])
        scores[:, joint] = np.where(there, scores[:, parts].min(axis=1), 0.0)
        views[:, joint] = np.where(there, views[:, parts].min(axis=1), 0)
