"""From solved joints to skeletons that are people: covariances, checks, derived joints."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from panoptic_ros.assembly.config import AssemblyConfig
from panoptic_ros.assembly.consensus import Scene
from panoptic_ros.assembly.map_votes import moved_to_votes
from panoptic_ros.assembly.nodes import has_maps, take_nodes
from panoptic_ros.assembly.solve import Solved
from panoptic_ros.domain import JointState, PoseSet, ProposalSet, SkeletonModel

Array = np.ndarray

LEARN_MOST = 1000  # residuals per instant
LEARN_LEVERAGE = 0.7  # residuals of observations that decide alone say nothing
TWO_VIEW_FACTOR = 1.2345  # two views leave one residual: |N(0, 1)| has another median than a 2D length
SAME_PERSON = 0.12  # m, mean joint distance below which two skeletons are one person


@dataclass(frozen=True, slots=True, eq=False)
class People:
    """Skeletons of one instant: P people of the K solved.

    kept: (P,) which of the solved. positions (P, J, 3), covariances (P, J, 3, 3), scores (P, J),
    views (P, J).
    """

    kept: Array
    positions: Array
    covariances: Array
    scores: Array
    views: Array

    def rows(self, which: Array) -> People:
        """Some of the people."""
        return People(
            self.kept[which], self.positions[which], self.covariances[which], self.scores[which],
            self.views[which],
        )  # fmt: skip

    def pose_set(self, item: ProposalSet, skeleton_hash: str) -> PoseSet:
        """The record."""
        measured = np.isfinite(self.positions[..., 0])
        states = np.where(measured, JointState.MEASURED, JointState.MISSING)
        person = self.scores.sum(axis=1) / np.maximum(measured.sum(axis=1), 1)
        return PoseSet(
            item.index, item.stamp_ns, skeleton_hash, self.positions, self.covariances, self.scores,
            self.views, states, person,
        )  # fmt: skip


def finish(
    scene: Scene, item: ProposalSet, solved: Solved, expected: Array, observed: Array,
    skeleton: SkeletonModel, config: AssemblyConfig,
) -> People:  # fmt: skip
    """Covariances and scores, derived joints, and only those skeletons that can be people.

    Args:
        expected: (P, J, 3) m, where joints should be, NaN = no idea; a place to look for nodes.
        observed: (P, J) number of views whose 2D person shows each joint.
    """
    views = solved.views
    covariances = joint_covariances(solved, config)
    with np.errstate(invalid="ignore"):
        worst = np.linalg.eigvalsh(np.where(np.isfinite(covariances), covariances, 0.0))[..., -1]
    good = np.isfinite(solved.positions[..., 0]) & np.isfinite(covariances[..., 0, 0])
    good &= worst <= config.max_joint_sigma**2
    scores = _scores(scene, solved)
    _drop_long_bones(solved.positions, worst, good, skeleton, config.max_bone)
    positions = np.where(good[..., None], solved.positions, np.nan)
    covariances = np.where(good[..., None, None], covariances, np.nan)
    views, scores = np.where(good, views, 0), np.where(good, scores, 0.0)
    if config.node_distance > 0.0 and has_maps(item):
        _use_nodes(item, expected, positions, covariances, scores, views, config)
    if config.vote_distance > 0.0:
        positions = moved_to_votes(positions, item, config.vote_distance)
    _derive(positions, covariances, scores, views, skeleton)
    kept = np.flatnonzero(_are_people(positions, good, observed, config))
    kept = kept[~_duplicates(positions[kept], views[kept])]
    return People(kept, positions[kept], covariances[kept], scores[kept], views[kept])


def joint_covariances(solved: Solved, config: AssemblyConfig) -> Array:
    """Covariances (P, J, 3, 3) m^2; NaN if singular.

    Inverse normal matrices, corrected for their Cauchy weights (those of good observations are below
    1, but cost little precision), and larger for few views.
    """
    lower = solved.normals
    normal = lower + np.swapaxes(np.tril(lower, -1), -1, -2)
    scale = np.trace(normal, axis1=-2, axis2=-1)
    good = np.isfinite(solved.positions[..., 0]) & (scale > 0.0)
    safe = np.where(good[..., None, None], normal, np.eye(3))
    safe = safe + 1e-9 * np.where(good, scale, 1.0)[..., None, None] * np.eye(3)
    inflation = 1.0 + config.covariance_inflation / np.maximum(solved.views - 1, 1)
    inflation *= cauchy_correction(config.cauchy)
    covariances = np.linalg.inv(safe) * inflation[..., None, None] + config.bias_floor**2 * np.eye(3)
    covariances = 0.5 * (covariances + np.swapaxes(covariances, -1, -2))
    return np.where(good[..., None, None], covariances, np.nan)


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


def _scores(scene: Scene, solved: Solved) -> Array:
    """Mean 2D score (P, J) of the observations that were used."""
    used = solved.residuals >= 0.0
    rows, joints = np.where(used, solved.picks[..., 0], 0), np.where(used, solved.picks[..., 1], 0)
    if not len(scene.evidence.view):
        return np.zeros(used.shape[:2])
    scores = np.where(used, scene.evidence.scores[rows, joints], 0.0)
    return scores.sum(axis=-1) / np.maximum(used.sum(axis=-1), 1)


def _drop_long_bones(
    positions: Array, worst: Array, good: Array, skeleton: SkeletonModel, longest: float
) -> None:
    """Remove (in `good`, in place) the less certain end of bones that nobody has."""
    for a, b in skeleton.bones:
        with np.errstate(invalid="ignore"):
            long = np.linalg.norm(positions[:, a] - positions[:, b], axis=-1) > longest
        long &= good[:, a] & good[:, b]
        good[:, a] &= ~(long & (worst[:, a] > worst[:, b]))
        good[:, b] &= ~(long & (worst[:, a] <= worst[:, b]))


def _use_nodes(
    item: ProposalSet, expected: Array, positions: Array, covariances: Array, scores: Array, views: Array,
    config: AssemblyConfig,
) -> None:  # fmt: skip
    """Put voted nodes in place of joints that are missing, or less certain than nodes, in place."""
    missing = np.isnan(positions[..., 0])
    variance = np.trace(covariances, axis1=-2, axis2=-1) / 3.0
    with np.errstate(invalid="ignore"):
        weak = missing | ((views <= 2) & (variance > config.node_sigma**2))
    chosen = take_nodes(item, np.where(missing[..., None], expected, positions), weak, config.node_distance)
    p, j = np.nonzero(chosen >= 0)
    nodes = chosen[p, j]
    positions[p, j], covariances[p, j] = item.nodes[nodes], config.node_sigma**2 * np.eye(3)
    scores[p, j], views[p, j] = item.node_scores[nodes], item.node_views[nodes]


def _derive(
    positions: Array, covariances: Array, scores: Array, views: Array, skeleton: SkeletonModel
) -> None:
    """Fill joints that are means of others, in place, with the covariance of the mean."""
    for joint, parts in skeleton.derived:
        parts = list(parts)
        positions[:, joint] = positions[:, parts].mean(axis=1)
        covariances[:, joint] = covariances[:, parts].sum(axis=1) / len(parts) ** 2
        there = np.isfinite(positions[:, joint, 0])
        scores[:, joint] = np.where(there, scores[:, parts].min(axis=1), 0.0)
        views[:, joint] = np.where(there, views[:, parts].min(axis=1), 0)


def _are_people(positions: Array, good: Array, observed: Array, config: AssemblyConfig) -> Array:
    """Which skeletons (P,) have enough joints, at a possible height, with views that agree on most."""
    count = good.sum(axis=1)
    agreed = (good & (observed >= 2)).sum(axis=1) >= config.min_agreed_share * (observed >= 2).sum(axis=1)
    heights = np.where(np.isfinite(positions[..., 2]), positions[..., 2], np.nan)
    middle = np.array([np.nanmedian(row) if np.isfinite(row).any() else -np.inf for row in heights])
    return agreed & (count >= config.min_person_joints) & (middle > config.lowest)


def _duplicates(positions: Array, views: Array) -> Array:
    """Which skeletons (P,) lie on another one that rests on more views."""
    weight = views.sum(axis=1)
    double = np.zeros(len(positions), bool)
    for i in range(len(positions)):
        for k in range(len(positions)):
            if i == k or double[k] or weight[k] < weight[i] or (weight[k] == weight[i] and k > i):
                continue
            gaps = np.linalg.norm(positions[i] - positions[k], axis=-1)
            known = np.isfinite(gaps)
            if known.sum() >= 3 and gaps[known].mean() < SAME_PERSON:
                double[i] = True
    return double


def residuals_to_learn(scene: Scene, solved: Solved, kept: Array) -> tuple[Array, Array, Array]:
    """Rows (N,), joints (N,) and residuals (N,) px, leverage taken out.

    From joints of three and more views; from those of two only where there are no others.
    """
    evidence = scene.evidence
    views = np.where(np.isfinite(solved.positions[..., 0]), solved.views, 0)[kept]
    least = 3 if (views >= 3).any() else 2
    used = (solved.picks[kept, ..., 0] >= 0) & (views >= least)[..., None]
    p, j, v = (index[:: 1 + len(index) // LEARN_MOST] for index in np.nonzero(used))
    p = kept[p]
    rows, joints = solved.picks[p, j, v, 0], solved.picks[p, j, v, 1]
    local = np.einsum("nij,nj->ni", evidence.rotations[v], solved.positions[p, j])
    local += evidence.translations[v]
    inverse = 1.0 / np.maximum(local[:, 2], 0.05)
    plane = local[:, :2] * inverse[:, None]
    jacobian = inverse[:, None, None] * (
        evidence.rotations[v][:, :2] - plane[:, :, None] * evidence.rotations[v][:, 2:3]
    )
    lower = solved.normals[p, j]
    normal = lower + np.swapaxes(np.tril(lower, -1), -1, -2)
    normal += 1e-9 * np.trace(normal, axis1=1, axis2=2)[:, None, None] * np.eye(3)
    spread = np.linalg.solve(normal, np.swapaxes(jacobian, 1, 2))
    leverage = 0.5 * np.einsum("nki,nik->n", jacobian, spread) * scene.precision[rows, joints] ** 2
    leverage = np.where(solved.residuals[p, j, v] >= 0.0, leverage, 0.0)
    fair = leverage < (LEARN_LEVERAGE if least > 2 else 0.9)
    error = np.linalg.norm(evidence.plane[rows, joints] - plane, axis=-1) * evidence.focals[v]
    length = error / np.sqrt(np.maximum(1.0 - leverage, 0.1)) * (1.0 if least > 2 else TWO_VIEW_FACTOR)
    return rows[fair], joints[fair], length[fair]
