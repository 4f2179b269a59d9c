"""Association stage: assigns 2D poses to tracked people, and finds new people."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from panoptic_ros.association.config import AssociationConfig
from panoptic_ros.association.grouping import assign, find_people
from panoptic_ros.association.known_occluders import limited, limits_of_rig
from panoptic_ros.domain import AssociationSet, DetectionSet, Evidence, Groups, Prediction, TrackSet
from panoptic_ros.domain.rig_arrays import RigArrays
from panoptic_ros.errors import DataError
from panoptic_ros.identity.motion import predicted
from panoptic_ros.solving.example import easy_instants
from panoptic_ros.solving.joint_records import PersonCandidates
from panoptic_ros.solving.joints import solve_joints
from panoptic_ros.solving.limbs import ANATOMY_VOTES, SideTest, limbs_of
from panoptic_ros.solving.scene import Scene, carried_ages, even_precision, gather, scene_of
from panoptic_ros.solving.triangulation import SolverRules
from panoptic_ros.stage import Notice, StageContext, StepResult
from panoptic_ros.state import Stateful, StateLayout

Array = np.ndarray
NOISE = 0.005  # standard deviation of a 2D joint, as a share of the image diagonal; relative weights only
# for new people; foreign_penalty is truncation^2, so no joint comes from another 2D pose
ROUGH = SolverRules(truncation=4.0, cauchy=2.0, gate=4.0, foreign_penalty=16.0, max_pairs=15)


class AssociationStage(Stateful):
    """Stage that makes an `AssociationSet` of a `DetectionSet`, guided by the `TrackSet` that is fed back.

    The constructor compiles the kernels, or loads them from the cache.
    """

    LAYOUT = StateLayout(
        "association",
        ("_tracks", "_last_ns"),
        (TrackSet,),
        same={"configuration": "_config", "cameras": "_names", "skeleton": "_hash"},
    )

    def __init__(self, config: AssociationConfig, context: StageContext):
        self._config, self._skeleton = config, context.skeleton
        self._hash = context.skeleton.hash  # kept, as the property computes it at each call
        self._rig, self._names = RigArrays.of(context.rig), context.rig.names
        self._limits = limits_of_rig(context.rig)
        self._mirror = np.array(context.skeleton.mirror, np.int64)
        self._sides = SideTest(context.skeleton, limbs_of(context.skeleton).groups)
        self.reset()
        for example in easy_instants(context.rig, context.skeleton):
            for item in self.step(example).outputs:
                self.step(_followed(item))
        self.reset()

    def reset(self) -> None:
        """Forget all tracks and the last timestamp."""
        self._tracks: TrackSet | None = None
        self._last_ns: int | None = None

    def flush(self) -> StepResult[AssociationSet]:
        """Reset the stage. It has no buffered records."""
        self.reset()
        return StepResult()

    def step(self, item: DetectionSet | TrackSet) -> StepResult[AssociationSet]:
        """Return the people of an instant, or store a `TrackSet`; drop sets from the past with a notice.

        Raises:
            DataError: if the detections do not fit the rig or the skeleton, or the tracks are of another
                skeleton.
        """
        if isinstance(item, TrackSet):
            if item.skeleton_hash != self._hash or item.ages.shape[1] != len(self._mirror):
                raise DataError(
                    f"tracks of skeleton {item.skeleton_hash} with {item.ages.shape[1]} joints, but "
                    f"association works on {self._skeleton.name} ({self._hash}) with {len(self._mirror)}"
                )
            self._tracks = item
            return StepResult()
        if self._limits:
            item = limited(item, self._limits)
        evidence = gather(item, self._rig, self._skeleton, self._hash, self._config.min_joint_score)
        if self._last_ns is not None and item.stamp_ns <= self._last_ns:
            text = f"a set of stamp {item.stamp_ns} came after one of {self._last_ns}; it was dropped"
            return StepResult(notices=(Notice("association.old_stamp", "warning", text),))
        self._last_ns = item.stamp_ns
        if not self._config.compensate_stamps:
            evidence = replace(evidence, delays=np.zeros_like(evidence.delays))
        return StepResult((self._associate(item, evidence),))

    def _associate(self, item: DetectionSet, evidence: Evidence) -> AssociationSet:
        """Find the tracked people first, then new people among the 2D poses that remain."""
        precision = even_precision(evidence, self._rig, NOISE)
        scene = scene_of(item, evidence, precision, self._mirror, self._rig, self._config.image_borders)
        prediction = self._predict(item.stamp_ns)
        known, who, free = self._known(scene, prediction)
        free &= carried_ages(item, evidence) == 0.0  # a 2D pose from optical flow alone starts no new person
        fresh, places = self._new(scene, free)
        return AssociationSet(
            item,
            evidence,
            known.joined(fresh),
            np.concatenate([who, np.full(len(places), -1)]),
            np.concatenate([prediction.positions[who], places]),
            prediction,
        )

    def _predict(self, stamp_ns: int) -> Prediction:
        """Return the predicted positions of the tracked people; without temporal guidance, of no person."""
        if self._tracks is None or not self._config.temporal_guidance:
            return Prediction.of_nobody(len(self._mirror))
        return predicted(self._tracks, stamp_ns, self._config.track_memory)

    def _known(self, scene: Scene, prediction: Prediction) -> tuple[Groups, Array, Array]:
        """Assign 2D poses to the predicted people, and keep the people that enough views show.

        Returns:
            their 2D poses, their rows in the prediction, and the 2D poses (D,) that remain free.
        """
        config, free = self._config, np.ones(len(scene.evidence.view), bool)
        groups, left = assign(
            scene, prediction.positions, prediction.velocities, free, config, config.guided_agreement
        )
        seen = (groups.member >= 0).sum(axis=1) >= self._config.guided_views
        lost = groups.member[~seen]
        left[lost[lost >= 0]] = True
        return groups.rows(seen), np.flatnonzero(seen), left

    def _new(self, scene: Scene, free: Array) -> tuple[Groups, Array]:
        """Find new people among the free 2D poses, correct exchanged sides, and estimate their joints.

        A joint is placed where most of the person's views, and at least two, agree.
        """
        groups, places = find_people(scene, free, self._config)
        if len(places):  # rarely true, so the solver seldom runs
            views = np.where(groups.member >= 0, np.where(groups.mirrored, 1.0, -1.0), 0.0).sum(axis=1)
            wrong = views > ANATOMY_VOTES * self._sides.of_body(places)
            groups = Groups(groups.member, groups.mirrored ^ wrong[:, None])
            found = PersonCandidates.new(groups, places, self._mirror)
            places = solve_joints(found, scene.observations, ROUGH).positions
            for joint, parts in self._skeleton.derived:
                places[:, joint] = places[:, list(parts)].mean(axis=1)
        return groups, places


def _followed(item: AssociationSet) -> TrackSet:
    """Return the people of a set as tracks, for compiling."""
    people, joints = item.places.shape[:2]
    states = np.concatenate([item.places, np.zeros((people, joints, 3))], axis=-1)
    numbers = np.zeros((people, joints))
    return TrackSet(
        item.index,
        item.stamp_ns,
        item.detections.skeleton_hash,
        np.zeros(people, np.int64),
        states,
        np.full((people, joints, 3), 1e-3),
        numbers,
        numbers,
        np.zeros(people),
    )
