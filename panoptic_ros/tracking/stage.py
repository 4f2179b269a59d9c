"""Tracking stage: assigns skeletons to tracks, and re-identifies people who return."""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from panoptic_ros.domain import PoseSet, SubjectSet, TrackedPoseSet, TrackSet, ViewAppearance
from panoptic_ros.domain.checks import known_good
from panoptic_ros.domain.of_all import joined, selected
from panoptic_ros.errors import DataError
from panoptic_ros.identity.appearance import ClothingColours, colour_evidence, looks_at
from panoptic_ros.identity.assignment import best_pairs
from panoptic_ros.identity.likeness import (
    NEW,
    WAIT,
    BoneLengths,
    bone_evidence,
    paired,
    place_evidence,
    recognised,
    seen_bones,
)
from panoptic_ros.identity.motion import JointMotion
from panoptic_ros.identity.numbering import numbering_order, numbering_places
from panoptic_ros.identity.returns import RETURN_S, is_pause, returns_at_once
from panoptic_ros.identity.subjects import PublicIds, subjects_of
from panoptic_ros.solving.limbs import limbs_of
from panoptic_ros.stage import Notice, StageContext, StepResult
from panoptic_ros.state import Stateful, StateLayout
from panoptic_ros.tracking.config import TrackingConfig
from panoptic_ros.tracking.tracks import ALONE, TrackedBodies, Tracks, head_distances, joint_distances

Array = np.ndarray
KEPT = 16  # size of each camera's buffer of newest `ViewAppearance` records that wait for their instant
OF_INSTANT = ("index", "stamp_ns", "skeleton_hash", "newest_ns")
OF_PEOPLE = ("positions", "covariances", "scores", "views", "states", "person_scores")


class ReidentificationCues(NamedTuple):
    """P people who have appeared.

    Args:
        middles: (P, 3) m, world, centres of the bodies.
        bones: Bone lengths.
        clothes: Colours of the clothes.
    """

    middles: Array
    bones: BoneLengths
    clothes: ClothingColours

    @classmethod
    def of_instant(cls, poses: PoseSet, rows: Array, looks: Array, bones: Array) -> ReidentificationCues:
        """Return the record of some skeletons of an instant.

        Args:
            rows: (K,) rows of these skeletons.
            looks: (P, 2, 3) colours of clothes of all skeletons, NaN = not seen.
            bones: (B, 2) joints at the ends of the bones.
        """
        positions = poses.positions[rows]
        known = seen_bones(positions, poses.covariances[rows], bones)
        return cls(np.nanmedian(positions, axis=1), known, ClothingColours.of_looks(looks[rows]))

    @classmethod
    def of_tracks(cls, tracks: Tracks) -> ReidentificationCues:
        """Return the record of people who were tracked since they appeared."""
        return cls(tracks.bodies.middles, tracks.bones, tracks.clothes)


def return_odds(lost: Tracks, came: ReidentificationCues, groups: Array) -> Array:
    """Return the log-odds (T, P) that T lost people are P new people, by bones, position and clothes.

    Args:
        groups: (B,) of bones, see `identity.likeness.paired`.
    """
    odds: Array = bone_evidence(lost.bones, came.bones, groups)
    odds += place_evidence(ground_distances(lost, came), lost.unseen)
    odds += colour_evidence(lost.clothes, came.clothes)
    return odds


def returned_at_once(
    lost: Tracks, came: ReidentificationCues, groups: Array, reach: Array
) -> list[tuple[int, int]]:
    """Return pairs (lost, new) of people who were lost at most RETURN_S ago and have reappeared nearby.

    See `identity.returns`.

    Args:
        groups: (B,) of bones, see `identity.likeness.paired`.
        reach: (T,) m, distance that each lost person may have moved.
    """
    near = ground_distances(lost, came) <= reach[:, None]
    return returns_at_once(return_odds(lost, came, groups), lost.missed, near)


def ground_distances(lost: Tracks, came: ReidentificationCues) -> Array:
    """Return the distances (T, P) m on the ground from predicted positions of lost people to new people."""
    distances: Array = np.linalg.norm((lost.bodies.middles[:, None] - came.middles[None])[..., :2], axis=-1)
    return distances


class TrackingStage(Stateful):
    """Stage that gives identities to the skeletons of a `PoseSet`, and reports all tracks to association."""

    LAYOUT = StateLayout(
        "tracking",
        ("_tracks", "_ids", "_last_ns", "_clothes"),
        (Tracks, JointMotion, TrackedBodies, ClothingColours, PublicIds, SubjectSet, ViewAppearance),
        lasting=("_ids",),
        same={"configuration": "_config", "skeleton": "_hash"},
    )

    def __init__(self, config: TrackingConfig, context: StageContext):
        self._config, self._skeleton = config, context.skeleton
        self._hash = context.skeleton.hash  # kept, as the property computes it at each call
        self._bones = np.array(context.skeleton.bones, np.int64).reshape(-1, 2)
        self._limbs = limbs_of(context.skeleton)
        self._pairs = paired(self._bones, np.array(context.skeleton.mirror, np.int64))
        self.reset()
        self._compile()
        self.reset()

    def reset(self) -> None:
        """Forget all tracks; ids start from 0."""
        self._tracks = self._new(0)
        self._ids = PublicIds(subjects_of(self._config.subjects))
        self._last_ns: int | None = None
        self._clothes: dict[str, deque[ViewAppearance]] = {}

    def forget(self) -> None:
        """Drop all tracks; ids and subjects continue."""
        super().forget()
        self._ids.begun_ns = None

    def flush(self) -> StepResult[TrackedPoseSet | TrackSet]:
        """Reset the stage. It has no buffered records."""
        self.reset()
        return StepResult()

    def step(self, item: PoseSet | SubjectSet | ViewAppearance) -> StepResult[TrackedPoseSet | TrackSet]:
        """Return the skeletons that have an identity, and all tracks; drop sets from the past with a notice.

        A `SubjectSet` replaces the designation of subjects. A `ViewAppearance` must come before the skeletons
        that are made from its image. Both give no output.

        Raises:
            DataError: if the poses are of another skeleton.
        """
        if isinstance(item, SubjectSet):
            self._ids.designate(item)
            return StepResult()
        if isinstance(item, ViewAppearance):
            self._clothes.setdefault(item.camera, deque(maxlen=KEPT)).append(item)
            return StepResult()
        if item.skeleton_hash != self._hash:
            raise DataError(
                f"poses of skeleton {item.skeleton_hash}, but tracking works on "
                f"{self._skeleton.name} ({self._hash})"
            )
        if item.side_votes is not None and item.side_votes.shape[1] != self._limbs.number:
            raise DataError(
                f"poses with votes about {item.side_votes.shape[1]} limbs, but {self._skeleton.name} has "
                f"{self._limbs.number}"
            )
        if self._last_ns is not None and item.stamp_ns <= self._last_ns:
            text = f"a set of stamp {item.stamp_ns} came after one of {self._last_ns}; it was dropped"
            return StepResult(notices=(Notice("tracking.old_stamp", "warning", text),))
        self._advance(item.stamp_ns)
        shown = as_images_show(item)
        seen = {} if item.sources is None else item.sources.taken_from(self._clothes)
        looks = looks_at(item.sources, seen, len(item.positions))
        owners = self._with_new(shown, self._assign(shown, looks))
        self._tracks.update(owners, shown, self._bones, self._skeleton.head)
        if self._clothes:
            own = np.flatnonzero(owners >= 0)
            self._tracks.clothes.learn(owners[own], looks[own])
        notices = self._confirm(shown, owners) + self._find_subjects(item.stamp_ns)
        ids = np.where(owners >= 0, self._tracks.ids[owners], -1) if len(owners) else owners
        self._tracks.exchange_sides(self._limbs)
        rows = np.flatnonzero((ids >= 0) & self._ids.are_reported(ids, self._config.bystanders))
        rows = rows[np.argsort(ids[rows])]
        return StepResult((tracked(item, rows, ids[rows]), self._tracks.record(item)), notices)

    def _new(self, people: int) -> Tracks:
        """Return tracks before their first measurement."""
        return Tracks.of_new(people, len(self._skeleton), len(self._bones), self._limbs.number)

    def _advance(self, stamp_ns: int) -> None:
        """Predict all tracks to the instant, and drop those that were unseen for too long.

        A track with an identity is dropped after `memory` s, a track without one after `joint_memory` s. A
        pause without sets does not count.
        """
        dt = 0.0 if self._last_ns is None else 1e-9 * (stamp_ns - self._last_ns)
        self._last_ns = stamp_ns
        tracks, config = self._tracks, self._config
        tracks.predict(dt, blind=bool(is_pause(dt)))
        kept = tracks.missed <= np.where(tracks.ids >= 0, config.memory, config.joint_memory)
        if not kept.all():
            kept |= np.isin(tracks.ids, self._ids.subjects.ids)  # tracks of subjects never end
            self._tracks = selected(tracks, kept)

    def _assign(self, item: PoseSet, looks: Array) -> Array:
        """Return the track (P,) of each skeleton, -1 = none.

        The distances of all joints decide first. The remaining skeletons may be lost people who reappear.
        With `method=head` the distance of the heads decides alone.

        Args:
            looks: (P, 2, 3) colours of clothes, NaN = not seen.
        """
        config, tracks = self._config, self._tracks
        owners, everybody = np.full(len(item.positions), -1), np.arange(len(tracks.ids))
        if config.method == "head":
            distance = head_distances(tracks.heads, item.positions, self._skeleton.head)
            _take(owners, everybody, distance, config.max_distance)
            return owners
        motion = tracks.motion
        states = np.where((motion.ages <= config.joint_memory)[..., None], motion.states, np.nan)
        distance, cost = joint_distances(states, motion.variances, item.positions, item.covariances)
        _take(owners, everybody, np.where(distance <= config.max_distance, cost, np.inf), ALONE)
        away = tracks.ids >= 0
        away[owners[owners >= 0]] = False
        lost = np.flatnonzero(away)
        open_rows = np.flatnonzero((owners < 0) & np.isfinite(item.positions[..., 0]).any(axis=1))
        if len(lost) and len(open_rows):  # a lost person may have reappeared
            gone = selected(tracks, lost)
            reach = config.return_distance + config.return_speed * gone.unseen
            came = ReidentificationCues.of_instant(item, open_rows, looks, self._bones)
            for t, p in returned_at_once(gone, came, self._pairs, reach):
                owners[open_rows[p]] = lost[t]
        return owners

    def _with_new(self, item: PoseSet, owners: Array) -> Array:
        """Return the owners, with new tracks for skeletons that have no track."""
        for k in np.flatnonzero((owners < 0) & np.isfinite(item.positions[..., 0]).any(axis=1)):
            owners[k] = len(self._tracks.ids)
            self._tracks = joined(self._tracks, self._new(1))
        return owners

    def _confirm(self, item: PoseSet, owners: Array) -> tuple[Notice, ...]:
        """Give identities to new tracks with enough evidence: those of lost people, or new ones.

        Returns:
            a notice for each identity.
        """
        ready = [
            k
            for k, t in enumerate(owners.tolist())
            if t >= 0
            and self._tracks.ids[t] < 0
            and (self._tracks.hits[t] >= self._config.confirm_frames or self._convinces(item, k))
        ]
        if not ready:
            return ()
        rows = np.array(ready)[numbering_order(numbering_places(item.positions[ready]))]
        tracks, notices, fresh = self._tracks, [], owners[rows]
        away = (tracks.ids >= 0) & (tracks.missed > RETURN_S)
        lost = np.flatnonzero((tracks.ids >= 0) & (tracks.missed > 0.0) & away.any())
        if self._config.method == "head":  # this method uses the head alone
            lost = lost[:0]
        came = ReidentificationCues.of_tracks(selected(tracks, fresh))
        odds = return_odds(selected(tracks, lost), came, self._pairs)
        found = recognised(odds, tracks.seconds[fresh], self._config.recognition_time)
        gone = []
        for t, who in zip(fresh.tolist(), found.tolist()):
            if who == WAIT:
                continue
            if who == NEW:
                number, word = self._ids.new(), "appeared"
            else:
                number, word = int(tracks.ids[lost[who]]), "returned"
                tracks.take_over(int(lost[who]), t)
                gone.append(int(lost[who]))
            tracks.ids[t] = number
            text = f"person {number} {word}"
            notices.append(Notice(f"tracking.{word}", "info", text, {"id": number}))
        if gone:
            kept = np.setdiff1d(np.arange(len(tracks.ids)), gone)
            owners[owners >= 0] = np.searchsorted(kept, owners[owners >= 0])
            self._tracks = selected(tracks, kept)
        return tuple(notices)

    def _find_subjects(self, stamp_ns: int) -> tuple[Notice, ...]:
        """Give the subjects' ids to the people who are designated; return a notice for each."""
        tracks = self._tracks
        found = self._ids.find_subjects(
            tracks.ids,
            tracks.unseen == 0.0,
            lambda rows: (tracks.bodies.middles[rows], tracks.bodies.drifts[rows]),
            stamp_ns,
        )
        return tuple(
            Notice("tracking.designated", "info", text, {"id": number, "before": before})
            for number, before in found
            for text in [f"subject {number} is the person who was {before}"]
        )

    def _convinces(self, item: PoseSet, k: int) -> bool:
        """Return whether a skeleton has enough views and joints to be confirmed at once."""
        measured = np.isfinite(item.positions[k, :, 0])
        agreed = measured & (item.views[k] >= 2)  # other joints were inferred from these joints
        wanted = min(self._config.confirm_views, float(item.views.max()))
        enough = agreed.any() and item.views[k][agreed].mean() >= wanted
        return bool(enough and measured.mean() >= self._config.confirm_joints)

    def _compile(self) -> None:
        """Compile the kernels with two instants of two people."""
        joints = len(self._skeleton)
        positions = np.random.default_rng(0).uniform(0.0, 1.0, (2, joints, 3))
        positions[1] += 9.0
        ones = np.ones((2, joints))
        covariances = np.tile(1e-4 * np.eye(3), (2, joints, 1, 1))
        for index in range(2):
            self.step(
                PoseSet(index, index, self._hash, positions, covariances, ones, 2 * ones, ones, np.ones(2))
            )


def _take(owners: Array, rows: Array, cost: Array, gate: float) -> None:
    """Write the rows (N,) that the best pairs of a cost (N, P) contain to `owners` (P,), in place."""
    for i, k in best_pairs(cost, gate):
        owners[k] = rows[i]


def as_images_show(item: PoseSet) -> PoseSet:
    """Return the skeletons without corrections of known detector biases.

    Predictions are compared with images, which have these biases.
    """
    if item.corrections is None:
        return item
    return replace(item, positions=item.positions - item.corrections)


def tracked(item: PoseSet, rows: Array, ids: Array) -> TrackedPoseSet:
    """Return the chosen skeletons (K,), each once, with their ids, but without side votes and corrections."""
    everybody = np.array_equal(rows, np.arange(len(item.positions)))  # then the arrays need no copy
    values = {name: getattr(item, name) for name in OF_INSTANT}
    for name in OF_PEOPLE:
        array = getattr(item, name)
        values[name] = array if everybody else array[rows]
    shift, sources = item.time_shift, item.sources
    if not everybody:
        shift = None if shift is None or not len(rows) else shift.rows(rows)
        sources = None if sources is None else sources.rows(rows)
    values |= {"time_shift": shift, "sources": sources, "side_votes": None, "corrections": None}
    return known_good(TrackedPoseSet, values | {"ids": np.array(ids, np.int64)})
