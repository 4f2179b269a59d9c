"""Assembly stage, and examples that compile its kernels before the first real instant."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from panoptic_ros.assembly.borders import artefacts, border_odds
from panoptic_ros.assembly.completion import CandidateObservations, hold_people, place_joints
from panoptic_ros.assembly.config import AssemblyConfig
from panoptic_ros.assembly.judgement import (
    FEW_VIEWS,
    AcceptanceCriteria,
    AssembledPeople,
    judge_joints,
    kept_people,
)
from panoptic_ros.assembly.lost_people import with_lost_people
from panoptic_ros.assembly.map_votes import VoteNoise, move_to_votes, vote_sigmas
from panoptic_ros.assembly.noise import NoiseCovariates, NoiseStatistics, NoiseTable
from panoptic_ros.assembly.occlusion import body_bones, hidden_marks
from panoptic_ros.assembly.residuals import residuals_to_learn
from panoptic_ros.assembly.skeletal_proposals import people_from_parts
from panoptic_ros.assembly.time_shift import MotionDependence, motion_of, solved_in_motion, time_shift
from panoptic_ros.domain import BiasTable, PoseSet, ProposalSet, Rig, ScoreMaps, SkeletonModel
from panoptic_ros.domain.of_all import selected
from panoptic_ros.domain.rig_arrays import RigArrays
from panoptic_ros.errors import ContractError
from panoptic_ros.geometry.robust import covariance_correction
from panoptic_ros.solving.bodies import SkeletonArrays
from panoptic_ros.solving.capture_space import in_capture_space, needed_views
from panoptic_ros.solving.example import beside, cloud_of_joints, easy_associations
from panoptic_ros.solving.joint_records import PersonCandidates, SolvedJoints, observed_views, view_sources
from panoptic_ros.solving.joints import compile_claims, solve_joints, solve_without
from panoptic_ros.solving.limbs import ANATOMY_VOTES, SideTest, exchanged_views, limbs_of
from panoptic_ros.solving.scene import Scene, cameras_of, carried_ages, check_association, scene_of
from panoptic_ros.solving.triangulation import SolverRules
from panoptic_ros.stage import StageContext, StepResult
from panoptic_ros.state import Fields, Stateful, StateLayout

Array = np.ndarray
DELAY_NS = 1000  # ns, difference between the timestamps of two views that makes them different instants


def example_sets(rig: Rig, skeleton: SkeletonModel) -> Iterator[ProposalSet]:
    """Yield example instants of a cloud of joints that cover all ways to find people.

    The ways are bones, 2D poses, guidance, parts and nodes. The instants have, in this order:

    * one view, without one joint;
    * several views without score maps;
    * several views with score maps, nodes and parts of the cloud, and further nodes beside it.
    """
    _, few = easy_associations(rig.subset(rig.names[:2]), skeleton)
    member, lengths = few.groups.member.copy(), np.full((1, len(skeleton.bones)), np.nan)
    member[:, 1:] = -1
    scores = few.evidence.scores.copy()
    scores[:, 0] = 0.0  # prediction and bones complete a tracked person
    yield ProposalSet.of_nothing(
        replace(
            few,
            evidence=replace(few.evidence, scores=scores),
            groups=replace(few.groups, member=member),
            prediction=replace(few.prediction, lengths=lengths),
        )
    )
    joints = np.arange(len(skeleton))
    cells = np.zeros((len(joints), 2))
    maps = ScoreMaps((1, 1), np.eye(2, 3), joints, 0 * joints - 1, cells, cells + 1, np.full(len(joints), 9))
    cloud = cloud_of_joints(rig, skeleton)
    nodes, ones = np.concatenate([cloud, cloud + beside(rig)]), np.ones(2 * len(joints))
    parts = np.array(skeleton.bones).reshape(-1, 2)
    first, second = easy_associations(rig, skeleton, DELAY_NS)
    yield ProposalSet.of_nothing(first)
    views = tuple(replace(view, maps=maps) for view in second.detections.views)
    second = replace(second, detections=replace(second.detections, views=views))
    yield ProposalSet(
        second,
        nodes,
        np.tile(joints, 2),
        0.9 * ones,
        4 * ones,
        parts,
        np.arange(len(parts)),
        np.full(len(parts), 0.9),
    )


class AssemblyStage(Stateful):
    """Stage that solves the skeletons of one instant, without identities, from a `ProposalSet`.

    The constructor compiles the kernels, or loads them from numba's cache.
    """

    LAYOUT = StateLayout(
        "assembly",
        ("_noise",),
        (Fields.named(NoiseTable, "_initial _memory _learnt learnt"), NoiseStatistics),
        same={"configuration": "_config", "cameras": "_context.rig.names", "skeleton": "_hash"},
    )

    def __init__(self, config: AssemblyConfig, context: StageContext):
        self._config, self._context, self._skeleton = config, context, context.skeleton
        self._hash = context.skeleton.hash  # kept, as the property computes it at each call
        self._rig = RigArrays.of(context.rig)
        self._biases = _bias_table(config, context)
        self._errs = any(context.skeleton.bias_floors)  # whether errors of the detector persist
        self._mirror = np.array(context.skeleton.mirror, np.int64)
        self._limbs = limbs_of(context.skeleton)
        self._needed_views = needed_views(config.capture_views, context.rig.cameras)
        self._rules = SolverRules(
            config.truncation, config.cauchy, config.gate, config.foreign_penalty, config.max_pairs
        )
        sigmas = vote_sigmas(context.skeleton, config.vote_sigma, config.torso_vote_sigma)
        self._votes = VoteNoise(config.vote_distance, sigmas, config.node_sigma)
        self._standards = AcceptanceCriteria(
            covariance_correction(config.cauchy),
            config.covariance_inflation,
            config.max_joint_sigma,
        )
        self._sides = SideTest(context.skeleton, self._limbs.groups)
        self._hiding, self._body = (
            body_bones(context.skeleton, self._sides.torso),
            SkeletonArrays.of(context.skeleton),
        )
        self.reset()
        for example in example_sets(context.rig, context.skeleton):
            self.step(example)
        compile_claims()  # image borders do not cut the people of the examples
        self.reset()

    def reset(self) -> None:
        """Discard the learnt noise."""
        config = self._config
        self._noise = NoiseTable(len(self._rig.focals), config.initial_noise, config.noise_memory)

    def flush(self) -> StepResult[PoseSet]:
        """Reset the stage; it has no buffered results."""
        self.reset()
        return StepResult()

    def step(self, item: ProposalSet) -> StepResult[PoseSet]:
        """Return the skeletons of this instant.

        Raises:
            DataError: if the people have another skeleton, or cameras that the rig lacks.
        """
        check_association(item.association, self._rig, self._skeleton, self._hash)
        if self._config.method == "dynamic_programming":
            people = people_from_parts(item, self._context.rig, self._skeleton, self._config)
            return StepResult((self._without_biases(people.pose_set(item)),))
        learns = self._config.learn_noise
        if learns and not self._noise.learnt:
            self._solve(item, learns)  # solve the first people again, with the noise learnt from them
            learns = False  # learn from each instant only once
        people, found, observed, motion = self._solve(item, learns)
        votes = exchanged_views(found.source, observed, self._limbs.groups)[people.kept]
        votes -= ANATOMY_VOTES * self._sides.right_way(people.joints.positions, people.joints.views)
        shift = None
        if motion is not None:
            positions, shifts = people.joints.positions, found.guide.shifts
            shift = time_shift(motion, people.kept, positions, shifts, self._skeleton)
        return StepResult((self._without_biases(people.pose_set(item, votes, shift)),))

    def _solve(
        self, item: ProposalSet, learns: bool
    ) -> tuple[AssembledPeople, PersonCandidates, Array, MotionDependence | None]:
        """Return people of an instant, the candidates, a mask (P, V, J) of observed joints, and the motion.

        Args:
            learns: Whether the noise table learns from the residuals.
        """
        evidence, prediction = item.association.evidence, item.association.prediction
        found = PersonCandidates.of(item.association, self._mirror)
        cams = cameras_of(evidence, self._rig)
        kinds = hidden_marks(found, self._hiding, cams, len(evidence.view))
        marks = NoiseCovariates.of(evidence, kinds, carried_ages(item.detections, evidence))
        precision = self._noise.precisions(marks, self._rig)
        borders = self._config.image_borders
        scene = scene_of(item.detections, evidence, precision, self._mirror, self._rig, borders)
        solved, motion = self._solve_joints(scene, found), None
        if scene.cams.delays.any() or scene.delays.any():
            found, solved, motion = solved_in_motion(scene, found, solved, prediction, self._rules)
        if self._config.lost_people and item.of_maps:
            known = len(found.who)
            found, solved = with_lost_people(item, found, solved, self._skeleton)
            if motion is not None and len(found.who) > known:
                motion = motion_of(scene, solved, found.guide.shifts, self._rules.cauchy)
        observed = observed_views(found, scene.precision)
        tails = self._noise.tails(marks)
        if not self._errs:
            tails[:] = 1.0
        people = self._finish(scene, item, (solved, found, motion), observed.sum(axis=1), tails)
        supporting, cameras = (found.member[people.kept] >= 0).sum(axis=1), self._context.rig.cameras
        inside = in_capture_space(people.joints.positions, supporting, cameras, self._needed_views)
        inside |= found.who[people.kept] >= 0  # tracks stay until no view shows them
        if not inside.all():
            people = people.rows(inside)
        if learns:
            residuals = residuals_to_learn(
                people.kept, solved, found.guide.shifts, scene.observations, scene.focals
            )
            self._noise.learn(marks, residuals, self._rig)
        return people, found, observed, motion

    def _solve_joints(self, scene: Scene, found: PersonCandidates) -> SolvedJoints:
        """Return the solved joints without artefacts of image borders.

        The precision of possible artefacts is reduced, and that of artefacts becomes 0, in place.
        """
        seen, rules = scene.observations, self._rules
        if not self._config.image_borders:
            return solve_joints(found, seen, rules)
        odds = border_odds(found, seen, scene.evidence.scores)
        seen.precision[...] /= np.sqrt(1.0 + odds)
        solved = solve_joints(found, seen, rules)
        wrong = artefacts(solved, found, seen, odds, rules.cauchy)
        if wrong.any():
            solve_without(wrong, solved, found, seen, rules)
        return solved

    def _finish(
        self,
        scene: Scene,
        item: ProposalSet,
        solution: tuple[SolvedJoints, PersonCandidates, MotionDependence | None],
        observed: Array,
        tails: Array,
    ) -> AssembledPeople:
        """Return the people that are possible, with all their joints, covariances and scores.

        Votes of maps move joints, bone lengths place joints of few views, and derived joints are computed.

        Args:
            solution: Tuple of solved joints, candidates and motion. Nodes are searched at the predicted
                joints of the candidates. The motion is None if all views have the same timestamp.
            observed: (P, J) number of views whose 2D pose shows each joint.
            tails: (D, J) of the 2D joints, see `judge_joints`.
        """
        solved, found, motion = solution
        config, member = self._config, found.member
        standards = self._standards
        joints, good = judge_joints(solved, observed, (scene.evidence.scores, tails), standards)
        if config.vote_distance > 0.0 and item.of_maps:
            expected = found.guide.positions
            shifts = _since_voting(item, found, motion)
            joints.positions[...] += shifts
            move_to_votes(joints, expected, item, self._skeleton, self._votes)
            joints.positions[...] -= shifts
        shown = (member >= 0).sum(axis=1)
        few = np.flatnonzero((shown > 0) & (shown <= FEW_VIEWS))
        if config.two_view_joints and len(few):
            place_joints(few, CandidateObservations.of(scene, found, tails), joints, self._body, scene.sight)
        joints.derive(self._skeleton)
        kept = kept_people(joints, good, member)
        own, placed = selected(joints, kept), np.zeros((len(kept), len(self._skeleton)), bool)
        incomplete = (shown > 0) & (found.who >= 0)
        incomplete[kept[np.isfinite(own.positions[..., 0]).all(axis=1)]] = False
        tracked = np.flatnonzero(incomplete)
        prediction = item.association.prediction
        if config.held_sigma > 0.0 and len(tracked) and prediction.lengths.shape[1] == len(self._body.bones):
            people, worst = (tracked, kept, own), config.held_sigma
            shows = CandidateObservations.of(scene, found, tails)
            kept, own, placed = hold_people(people, scene, shows, prediction, self._body, worst)
        sources = view_sources(item.detections, scene.evidence, found, solved, kept)
        return AssembledPeople(kept, own, sources, placed)

    def _without_biases(self, poses: PoseSet) -> PoseSet:
        """Return the skeletons without known biases of the detector; `corrections` states the difference."""
        if self._biases is None:
            return poses
        corrections = self._biases.corrections(poses.positions)
        return replace(poses, positions=poses.positions + corrections, corrections=corrections)


def _since_voting(
    item: ProposalSet, found: PersonCandidates, motion: MotionDependence | None
) -> Array | float:
    """Return the displacements (P, J, 3) m of joints if their velocities were the predicted ones.

    Voting used these velocities. The result is 0 if all views have the same timestamp.
    """
    if motion is None:
        return 0.0
    known, slower = found.who >= 0, np.zeros_like(found.guide.shifts)
    slower[known] = found.guide.shifts[known]
    slower[known] -= item.association.prediction.velocities[found.who[known]]
    shifts: Array = (motion.delays @ slower[..., None])[..., 0]
    return shifts


def _bias_table(config: AssemblyConfig, context: StageContext) -> BiasTable | None:
    """Return the bias table, which is the extra "bias_table" of the context; None if not configured.

    Raises:
        ContractError: if the extra is missing, or has another number of joints.
    """
    if not config.bias_table:
        return None
    table = context.extras.get("bias_table")
    if not isinstance(table, BiasTable) or len(table.offsets) != len(context.skeleton):
        raise ContractError(f"assembly.bias_table = {config.bias_table!r} needs the extra 'bias_table'")
    return table
