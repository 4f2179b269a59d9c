"""Tests of skeletons: certainty of their joints, and which of them are second skeletons of one person."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from panoptic_ros.domain import (
    JointState,
    PoseSet,
    ProposalSet,
    SkeletonModel,
    TimeShift,
    ViewSources,
)
from panoptic_ros.domain.checks import known_good
from panoptic_ros.domain.of_all import selected
from panoptic_ros.geometry.symmetric import invert_symmetric, largest_eigenvalue
from panoptic_ros.kernels import njit

Array = np.ndarray

MISSING, MEASURED, _, FILLED = (int(state) for state in JointState)  # enum members are slow to look up
FEW_VIEWS = 2  # number of views among which a wrong one cannot be identified
SAME_PERSON = 0.12  # m, mean joint distance below which two skeletons are one person's
SAME_JOINTS = 3  # minimum number of joints that such skeletons share


class JointEstimates(NamedTuple):
    """Joints of P people; the arrays change in place where joints are corrected.

    Args:
        positions: (P, J, 3) m, world, NaN = missing.
        covariances: (P, J, 3, 3) m^2.
        scores: (P, J).
        views: (P, J) number of views.
        doubts: (P, J) m^2 per axis, additional variance because the joint may be at a wrong node.
    """

    positions: Array
    covariances: Array
    scores: Array
    views: Array
    doubts: Array

    @classmethod
    def nothing(cls, people: int, joints: int) -> JointEstimates:
        """Return joints that are all missing."""
        shape = (people, joints)
        return cls(
            np.full((*shape, 3), np.nan),
            np.full((*shape, 3, 3), np.nan),
            np.zeros(shape),
            np.zeros(shape, np.int64),
            np.zeros(shape),
        )

    def derive(self, skeleton: SkeletonModel) -> None:
        """Fill missing joints that are means of other joints, with the covariance of the mean."""
        for joint, others in skeleton.derived:
            parts = list(others)
            place = self.positions[:, parts].mean(axis=1)
            rows = np.flatnonzero(np.isnan(self.positions[:, joint, 0]) & np.isfinite(place[:, 0]))
            self.positions[rows, joint] = place[rows]
            self.covariances[rows, joint] = self.covariances[rows][:, parts].sum(axis=1) / len(parts) ** 2
            self.doubts[rows, joint] = self.doubts[rows][:, parts].sum(axis=1) / len(parts) ** 2
            self.scores[rows, joint] = self.scores[rows][:, parts].min(axis=1)
            self.views[rows, joint] = self.views[rows][:, parts].min(axis=1)


@dataclass(frozen=True, slots=True, eq=False)
class AssembledPeople:
    """Skeletons of one instant: P people out of the K that were solved.

    Args:
        kept: (P,) rows among the solved people.
        joints: Their joints.
        sources: Their 2D poses.
        placed: (P, J) whether bones and the prediction helped to place the joint.
    """

    kept: Array
    joints: JointEstimates
    sources: ViewSources
    placed: Array

    def rows(self, which: Array) -> AssembledPeople:
        """Return the people that a mask (P,) selects."""
        return AssembledPeople(
            self.kept[which],
            selected(self.joints, which),
            self.sources.rows(np.flatnonzero(which)),
            self.placed[which],
        )

    def pose_set(
        self, item: ProposalSet, votes: Array | None = None, shift: TimeShift | None = None
    ) -> PoseSet:
        """Return the people as a `PoseSet`.

        Args:
            votes: (P, G) votes about the sides of limbs, see `PoseSet.side_votes`.
            shift: Dependence on motion; None if all views have the same timestamp.
        """
        joints = self.joints
        measured = np.isfinite(joints.positions[..., 0])
        states = np.where(measured, np.where(self.placed, FILLED, MEASURED), MISSING)
        newest = max((view.stamp_ns for view in item.detections.views), default=-1)
        person = joints.scores.sum(axis=1) / np.maximum(measured.sum(axis=1), 1)
        covariances = joints.covariances + joints.doubts[..., None, None] * np.eye(3)
        return known_good(
            PoseSet,
            {
                "index": item.index,
                "stamp_ns": item.stamp_ns,
                "skeleton_hash": item.detections.skeleton_hash,
                "positions": joints.positions,
                "covariances": covariances,
                "scores": joints.scores,
                "views": joints.views.astype(np.int32),
                "states": states.astype(np.uint8),
                "person_scores": person,
                "newest_ns": max(newest, item.stamp_ns),
                "time_shift": shift if len(states) else None,
                "sources": self.sources if self.sources.cameras else None,
                "side_votes": votes,
                "corrections": None,
            },
        )


class AcceptanceCriteria(NamedTuple):
    """Conditions that joints and people must satisfy; see `AssemblyConfig`.

    Covariances are multiplied by inflation * (1 + (extra + unused) / (views - 1)). The reason is that few
    views, or views that disagree, may have met by chance.

    Args:
        inflation: Correction of covariances for robust weights.
        extra: Additional growth of covariances for few views.
        worst: m, largest standard deviation of a joint along its longest axis.
    """

    inflation: float
    extra: float
    worst: float


@njit(cache=True, error_model="numpy")
def judge_joints(solved, observed, marked, standards):
    """Return the solved joints that are certain enough, as `JointEstimates`, and a mask (P, J) of them.

    Joints with a singular covariance are excluded.

    Args:
        solved: `SolvedJoints`.
        observed: (P, J) number of views whose 2D pose shows each joint, including views that were not used.
        marked: Scores (D, J) and tails (D, J) of the 2D joints. Tails are factors on the standard deviations
            where no further view shows a joint.
        standards: `AcceptanceCriteria`.
    """
    scores, tails = marked
    people, joints, count_views = solved.residuals.shape
    places, covariances = solved.positions.copy(), np.full((people, joints, 3, 3), np.nan)
    mean = np.zeros((people, joints))
    views, good = np.zeros((people, joints), np.int64), np.zeros((people, joints), np.bool_)
    for p in range(people):
        for j in range(joints):
            total = squares = 0.0
            for v in range(count_views):
                if solved.residuals[p, j, v] >= 0.0:
                    d, s = solved.picks[p, j, v]
                    views[p, j] += 1
                    total += scores[d, s]
                    squares += tails[d, s] ** 2
            mean[p, j] = total / max(views[p, j], 1)
            if np.isfinite(places[p, j, 0]):
                unused = max(observed[p, j] - views[p, j], 0)
                doubt = 1.0 + (standards.extra + unused) / max(views[p, j] - 1, 1)
                invert_symmetric(solved.normals[p, j], standards.inflation * doubt, covariances[p, j])
                if np.isfinite(covariances[p, j, 0, 0]):
                    good[p, j] = largest_eigenvalue(covariances[p, j]) <= standards.worst**2
                    if views[p, j] + unused <= FEW_VIEWS:  # with more views, disagreement already counts
                        covariances[p, j] *= squares / max(views[p, j], 1)
        for j in range(joints):
            if not good[p, j]:
                places[p, j], covariances[p, j] = np.nan, np.nan
                mean[p, j], views[p, j] = 0.0, 0
    return JointEstimates(places, covariances, mean, views, np.zeros((people, joints))), good


@njit(cache=True, error_model="numpy")
def kept_people(joints, good, member):
    """Return the rows of the skeletons that can be people, one row per person.

    They have a joint that is certain enough. For people without 2D poses, at nodes of score maps, any joint
    is enough.

    Args:
        joints: `JointEstimates`.
        good: (P, J) whether the joint is certain enough.
        member: (P, V) row of the 2D pose, -1 = none.
    """
    there = np.zeros(len(good), np.bool_)
    for p in range(len(good)):
        lost = np.all(member[p] < 0)
        there[p] = good[p].any() or (lost and np.isfinite(joints.positions[p, :, 2]).any())
    kept = np.flatnonzero(there)
    return kept[~second_skeletons(joints.positions[kept], joints.views[kept])]


@njit(cache=True, error_model="numpy")
def second_skeletons(positions, views):
    """Return a mask (P,) of skeletons that coincide with a skeleton based on more views.

    If both have equally many views, the first stays.

    Args:
        positions: (P, J, 3) m.
        views: (P, J) number of views.
    """
    people, joints = views.shape
    double = np.zeros(people, np.bool_)
    weight = np.zeros(people, np.int64)
    for p in range(people):
        for j in range(joints):
            weight[p] += views[p, j]
    for i in range(people):
        for k in range(people):
            if i == k or double[k] or weight[k] < weight[i] or (weight[k] == weight[i] and k > i):
                continue
            total, known = 0.0, 0
            for j in range(joints):
                gap = _gap(positions[i, j], positions[k, j])
                if np.isfinite(gap):
                    total += gap
                    known += 1
            if known >= SAME_JOINTS and total < SAME_PERSON * known:
                double[i] = True
    return double


@njit(cache=True, error_model="numpy")
def _gap(a, b):
    """Return the distance of two points."""
    return np.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)
