"""The assembly stage."""
from __future__ import annotations

import numpy as np

from panoptic_ros.assembly.config import AssemblyConfig
from panoptic_ros.assembly.consensus import Grouping, Scene, assign, find_people
from panoptic_ros.assembly.evidence import Evidence, RigArrays, gather
from panoptic_ros.assembly.guidance import Guidance, Prediction
from panoptic_ros.assembly.limbs import Sides, exchanged_views, limb_groups
from panoptic_ros.assembly.noise import NoiseTable
from panoptic_ros.assembly.people import finish, residuals_to_learn
from panoptic_ros.assembly.solve import Guide, Solver, observed_views, sources
from panoptic_ros.domain import PoseSet, ProposalSet
from panoptic_ros.stage import Notice, StageContext, StepResult

Array = np.ndarray

ANATOMY_VOTES = 2.0  # views that the place of the nose is worth in saying which side is left
CHOICE_SPREAD = 0.06  # m, how far from its prediction a joint is expected at once
CHOICE_SPEED = 0.6  # m/s, and how that grows with the time since it was seen


class AssemblyStage:
    """Skeletons of one instant, without identity, from a `ProposalSet`."""

    def __init__(self, config: AssemblyConfig, context: StageContext):
        self._config, self._skeleton = config, context.skeleton
        self._rig = RigArrays.of(context.rig)
        self._mirror = np.array(context.skeleton.mirror, np.int64)
        self._groups, count = limb_groups(context.skeleton)
        self._solver = Solver(config, self._groups, count)
        self._sides = Sides(context.skeleton, self._groups)
        self.reset()

    def reset(self) -> None:
        """Forget all people and all noise that was learnt."""
        config = self._config
        self._noise = NoiseTable(len(self._rig.focals), config.initial_noise, config.noise_memory)
        self._guidance = Guidance(self._mirror, self._groups, config.track_memory, config.acceleration)
        self._last_ns: int | None = None

    def flush(self) -> StepResult[PoseSet]:
        """Nothing is buffered."""
        self.reset()
        return StepResult()

    def step(self, item: ProposalSet) -> StepResult[PoseSet]:
        """Skeletons of this instant.

        Raises:
            DataError: if the detections do not fit the rig or the skeleton.
        """
        evidence = gather(item.detections, self._rig, self._skeleton, self._config.min_joint_score)
        if self._last_ns is not None and item.stamp_ns <= self._last_ns:
            text = f"a set of stamp {item.stamp_ns} came after one of {self._last_ns}; it was dropped"
            return StepResult(notices=(Notice("assembly.old_stamp", "warning", text),))
        dt = 0.0 if self._last_ns is None else 1e-9 * (item.stamp_ns - self._last_ns)
        self._last_ns = item.stamp_ns
        scene = self._scene(evidence)
        prediction = self._guidance.predict(dt)
        grouping, source, guide, who = self._consensus(scene, prediction)
        solved = self._solver.solve(scene, grouping, source, guide)
        observed = observed_views(scene, grouping, source)
        people = finish(scene, solved, observed.sum(axis=1), self._skeleton, self._config)
        if self._config.learn_noise:
            self._learn(scene, solved, people.kept)
        if self._config.temporal_guidance:
            exchanged = exchanged_views(source, observed, self._groups)[people.kept]
            exchanged -= ANATOMY_VOTES * self._sides.right_way(people.positions)
            self._guidance.update(who[people.kept], people.positions, people.covariances, exchanged)
        return StepResult((people.pose_set(item, self._skeleton.hash),))

    def _scene(self, evidence: Evidence) -> Scene:
        """Evidence with the noise that is known by now."""
        cameras = evidence.cameras[evidence.view]
        sigmas = self._noise.sigmas(evidence.scores, cameras, self._rig.diagonals)
        precision = np.where(evidence.scores > 0.0, self._rig.focals[cameras][:, None] / sigmas, 0.0)
        delays = evidence.delays if self._config.compensate_stamps else np.zeros_like(evidence.delays)
        cams = (evidence.rotations, evidence.translations, delays)
        return Scene(evidence, precision, self._mirror, cams)

    def _consensus(
        self, scene: Scene, prediction: Prediction
    ) -> tuple[Grouping, Array, Guide, Array]:
        """Known people first, then new ones from what is left."""
        free = np.ones(len(scene.evidence.view), bool)
        known, free = assign(scene, prediction.positions, prediction.velocities, free, self._config)
        seen = (known.member >= 0).sum(axis=1) >= 2
        known = Grouping(known.member[seen], known.mirrored[seen])
        fresh, places = find_people(scene, free, self._config)
        votes = np.where(fresh.member >= 0, np.where(fresh.mirrored, 1.0, -1.0), 0.0).sum(axis=1)
        if self._groups.max(initial=-1) >= 0:
            votes -= ANATOMY_VOTES * self._sides.right_way(places).mean(axis=1)
        fresh.mirrored ^= (votes > 0.0)[:, None]
        grouping = known.joined(fresh)
        count = len(places)
        nothing = np.full((count, len(self._mirror), 3), np.nan)
        spreads = CHOICE_SPREAD + CHOICE_SPEED * prediction.ages[seen]
        guide = Guide(
            np.concatenate([prediction.positions[seen], nothing]),
            np.concatenate([spreads, np.full(nothing.shape[:2], CHOICE_SPREAD)]),
            np.concatenate([prediction.velocities[seen], np.zeros_like(nothing)]),
        )
        who = np.concatenate([np.flatnonzero(seen), np.full(count, -1)])
        return grouping, sources(grouping.mirrored, self._mirror), guide, who

    def _learn(self, scene: Scene, solved, kept: Array) -> None:  # type: ignore[no-untyped-def]
        """Update the noise table from this instant's residuals."""
        rows, joints, pixels = residuals_to_learn(scene, solved, kept)
        cameras = scene.evidence.cameras[scene.evidence.view[rows]]
        self._noise.learn(scene.evidence.scores[rows, joints], cameras, pixels, self._rig.diagonals)
