"""From solved joints to skeletons that are people: covariances, checks, derived joints."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from panoptic_ros.assembly.config import AssemblyConfig
from panoptic_ros.assembly.few_views import hold_people, place_shown
from panoptic_ros.assembly.judgement import Joints, Standards, judge_joints, kept_people
from panoptic_ros.assembly.map_votes import move_to_votes
from panoptic_ros.assembly.time_shift import Motion
from panoptic_ros.domain import (
    DetectionSet,
    Evidence,
    JointState,
    PoseSet,
    ProposalSet,
    SkeletonModel,
    TimeShift,
    ViewSources,
)
from panoptic_ros.domain.checks import known_good
from panoptic_ros.geometry.robust import covariance_correction
from panoptic_ros.kernels import njit
from panoptic_ros.solving.bodies import Body
from panoptic_ros.solving.joint_records import Candidates, SolvedJoints
from panoptic_ros.solving.scene import Scene

Array = np.ndarray

MISSING, MEASURED, _, FILLED = (int(state) for state in JointState)  # members are slow to look up


@dataclass(frozen=True, slots=True, eq=False)
class People:
    """Skeletons of one instant: P people of the K solved.

    kept: (P,) which of the solved. joints: theirs. sources: their 2D people. placed: (P, J) joints that bones
    have placed, with the help of the prediction.
    """

    kept: Array
    joints: Joints
    sources: ViewSources
    placed: Array

    def rows(self, which: Array) -> People:
        """Some of the people, by a mask (P,)."""
        return People(
            self.kept[which], self.joints.rows(which), self.sources.rows(np.flatnonzero(which)),
            self.placed[which],
        )  # fmt: skip

    def pose_set(
        self, item: ProposalSet, votes: Array | None = None, shift: TimeShift | None = None
    ) -> PoseSet:
        """The record, with votes (P, G) about the sides of limbs."""
        joints = self.joints
        measured = np.isfinite(joints.positions[..., 0])
        states = np.where(measured, np.where(self.placed, FILLED, MEASURED), MISSING)
        newest = max((view.stamp_ns for view in item.detections.views), default=-1)
        person = joints.scores.sum(axis=1) / np.maximum(measured.sum(axis=1), 1)
        covariances = joints.covariances + joints.doubts[..., None, None] * np.eye(3)
        return known_good(PoseSet, {
            "index": item.index, "stamp_ns": item.stamp_ns, "skeleton_hash": item.detections.skeleton_hash,
            "positions": joints.positions, "covariances": covariances, "scores": joints.scores,
            "views": joints.views.astype(np.int32), "states": states.astype(np.uint8),
            "person_scores": person, "newest_ns": max(newest, item.stamp_ns),
            "time_shift": shift if len(states) else None,
            "sources": self.sources if self.sources.cameras else None, "side_votes": votes,
            "corrections": None,
        })  # fmt: skip


class Finisher:
    """Completes solved joints, and keeps the skeletons that can be people."""

    def __init__(self, config: AssemblyConfig, skeleton: SkeletonModel):
        self._config, self._skeleton = config, skeleton
        self._bones = np.array(skeleton.bones, np.int64).reshape(-1, 2)
        self._body = Body.of(skeleton)
        self._standards = Standards(
            covariance_correction(config.cauchy), config.covariance_inflation, config.max_joint_sigma,
            config.max_bone, config.min_agreed_share, config.min_person_joints, config.lowest,
        )  # fmt: skip

    def finish(
        self, scene: Scene, item: ProposalSet, solved: SolvedJoints, found: Candidates, observed: Array,
        motion: Motion | None = None,
    ) -> People:  # fmt: skip
        """Covariances and scores, joints that maps or few views tell, derived joints; only possible people.

        Args:
            found: the people that were solved; where they expect joints, nodes are looked for.
            observed: (P, J) number of views whose 2D person shows each joint.
            motion: None where all stamps are equal.
        """
        config, member = self._config, found.grouping.member
        joints, good = judge_joints(solved, observed, scene.evidence.scores, self._bones, self._standards)
        if config.vote_distance > 0.0 and item.of_maps:
            expected = found.guide.positions
            shifts = _since_voting(item, found, motion)
            joints.positions[...] += shifts
            move_to_votes(joints, expected, item, self._skeleton, config.vote_distance, config.node_sigma)
            joints.positions[...] -= shifts
        if config.two_view_joints:
            place_shown(scene, found, joints, self._body)
        joints.derive(self._skeleton)
        kept = kept_people(joints, good, observed, member, self._standards)
        own, placed = joints.rows(kept), np.zeros((len(kept), len(self._skeleton)), bool)
        if config.held_sigma > 0.0:
            kept, own, placed = hold_people(
                scene, found, item.association.prediction, kept, own, self._body, config.held_sigma
            )
        sources = view_sources(item.detections, scene.evidence, found, solved, kept)
        return People(kept, own, sources, placed)


def _since_voting(item: ProposalSet, found: Candidates, motion: Motion | None) -> Array | float:
    """By how much (P, J, 3) m joints would lie elsewhere with the predicted velocities, which votes go by."""
    if motion is None:
        return 0.0
    known, slower = found.who >= 0, np.zeros_like(found.guide.shifts)
    slower[known] = found.guide.shifts[known]
    slower[known] -= item.association.prediction.velocities[found.who[known]]
    shifts: Array = (motion.delays @ slower[..., None])[..., 0]
    return shifts


def view_sources(
    detections: DetectionSet, evidence: Evidence, found: Candidates, solved: SolvedJoints, kept: Array
) -> ViewSources:
    """The record for those of the people solved that were kept (P,)."""
    views = [detections.views[slot] for slot in evidence.slots]
    rows = main_people(
        evidence.starts, found.grouping.member[kept], solved.residuals[kept], solved.picks[kept]
    )
    known = np.concatenate([evidence.rows, [-1]])  # -1 stays -1
    return known_good(ViewSources, {
        "cameras": tuple(view.camera for view in views),
        "frames": np.array([view.frame_number for view in views], np.int64),
        "persons": known[rows].astype(np.int32),
    })  # fmt: skip


@njit(cache=True, error_model="numpy")
def main_people(starts, member, residuals, picks):
    """Row (P, V) of the 2D person of each view that gave most joints to each skeleton, -1 = none.

    Detectors mix people up where they overlap, so that somebody's joints can come from two 2D people of one
    view. A view where association found no 2D person has none, even if single joints of others were used.

    Args:
        starts: (V + 1,) first row of each view. member: (P, V) row that association gave, -1 = none; it
            wins where another gave as many, and where no joint of the view was used.
        residuals: (P, J, V), -1 = unused. picks: (P, J, V, 2) row and joint. See `SolvedJoints`.
    """
    people, joints, views = residuals.shape
    given = np.zeros(starts[-1])  # joints, by each 2D person
    main = np.full((people, views), -1, np.int64)
    for p in range(people):
        for d in range(len(given)):
            given[d] = 0.0
        for j in range(joints):
            for v in range(views):
                if residuals[p, j, v] >= 0.0:
                    given[picks[p, j, v, 0]] += 1.0
        for v in range(views):
            best = member[p, v]
            for d in range(starts[v], starts[v + 1] if best >= 0 else starts[v]):
                if given[d] > given[best]:
                    best = d
            main[p, v] = best
    return main
