"""The tracking stage."""
from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from panoptic_ros.domain import PoseSet, TrackedPoseSet, TrackSet
from panoptic_ros.errors import DataError
from panoptic_ros.solving.limbs import limbs_of
from panoptic_ros.stage import Notice, StageContext, StepResult
from panoptic_ros.state import Stateful, StateLayout
from panoptic_ros.tracking.config import TrackingConfig
from panoptic_ros.tracking.tracks import Tracks, head_distances, joint_distances, return_costs

Array = np.ndarray
FORBIDDEN = 1e6  # cost of pairs outside of the gates
BLIND_S = (0.5, 15.0)  # between two sets: shorter is a slow camera, longer another scene


class TrackingStage(Stateful):
    """Identities for the skeletons of a `PoseSet`; what is known of everybody goes back to association."""

    LAYOUT = StateLayout(
        "tracking", ("_tracks", "_next", "_last_ns"), (Tracks,),
        same={"configuration": "_config", "skeleton": "_hash"},
    )  # fmt: skip

    def __init__(self, config: TrackingConfig, context: StageContext):
        self._config, self._skeleton = config, context.skeleton
        self._hash = context.skeleton.hash  # computed at each call
        self._bones = np.array(context.skeleton.bones, np.int64).reshape(-1, 2)
        self._limbs = limbs_of(context.skeleton)
        self.reset()
        self._compile()
        self.reset()

    def reset(self) -> None:
        """Forget everybody; ids start from 0."""
        self._tracks = self._new(0)
        self._next = 0
        self._last_ns: int | None = None

    def flush(self) -> StepResult[TrackedPoseSet | TrackSet]:
        """Nothing is buffered."""
        self.reset()
        return StepResult()

    def step(self, item: PoseSet) -> StepResult[TrackedPoseSet | TrackSet]:
        """The skeletons that have an identity, and all tracks; sets from the past are dropped with a notice.

        Raises:
            DataError: if the poses are of another skeleton.
        """
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
        shown = _as_images_show(item)
        owners = self._with_new(shown, self._assign(shown))
        self._tracks.update(owners, shown, self._bones, self._skeleton.head)
        notices = self._confirm(shown, owners)
        ids = np.where(owners >= 0, self._tracks.ids[owners], -1) if len(owners) else owners
        self._tracks.exchange_sides(self._limbs)
        rows = np.flatnonzero(ids >= 0)
        rows = rows[np.argsort(ids[rows])]
        return StepResult((_tracked(item, rows, ids[rows]), self._tracks.record(item)), notices)

    def _new(self, people: int) -> Tracks:
        """Tracks before their first measurement."""
        return Tracks.of_new(people, len(self._skeleton), len(self._bones), self._limbs.number)

    def _advance(self, stamp_ns: int) -> None:
        """Predict all tracks to the instant, and drop those that were unseen for too long.

        Time in which no set came is not held against anybody: cameras paused, or a node was started anew.
        """
        dt = 0.0 if self._last_ns is None else 1e-9 * (stamp_ns - self._last_ns)
        self._last_ns = stamp_ns
        tracks, config = self._tracks, self._config
        tracks.predict(dt, blind=BLIND_S[0] < dt <= BLIND_S[1])
        kept = tracks.missed <= np.where(tracks.ids >= 0, config.memory, config.joint_memory)
        if not kept.all():
            self._tracks = tracks.rows(kept)

    def _assign(self, item: PoseSet) -> Array:
        """The track (P,) of each skeleton, -1 = none: first by joints, then of people who come back."""
        config, tracks = self._config, self._tracks
        owners, everybody = np.full(len(item.positions), -1), np.arange(len(tracks.ids))
        if config.method == "head":
            distance = head_distances(tracks.heads, item.positions, self._skeleton.head)
            _match(owners, everybody, np.where(distance <= config.max_distance, distance, np.inf))
            return owners
        states = np.where((tracks.ages <= config.joint_memory)[..., None], tracks.states, np.nan)
        distance, cost = joint_distances(states, tracks.variances, item.positions, item.covariances)
        _match(owners, everybody, np.where(distance <= config.max_distance, cost, np.inf))
        waiting = np.setdiff1d(np.flatnonzero(tracks.ids >= 0), owners)
        open_rows = np.flatnonzero(owners < 0)
        if len(waiting) and len(open_rows):  # somebody may have come back
            lost = tracks.rows(waiting)
            distance, difference = return_costs(lost, item.positions[open_rows], self._bones)
            reach = (config.return_distance + config.return_speed * lost.unseen)[:, None]
            allowed = (distance <= reach) & (difference <= config.bone_tolerance)
            score = distance / np.maximum(reach, 1e-9) + difference / config.bone_tolerance
            back = np.full(len(open_rows), -1)
            _match(back, waiting, np.where(allowed, score, np.inf))
            owners[open_rows] = back
        return owners

    def _with_new(self, item: PoseSet, owners: Array) -> Array:
        """The owners, with new tracks for skeletons that are nobody's."""
        for k in np.flatnonzero((owners < 0) & np.isfinite(item.positions[..., 0]).any(axis=1)):
            owners[k] = len(self._tracks.ids)
            self._tracks = self._tracks.joined(self._new(1))
        return owners

    def _confirm(self, item: PoseSet, owners: Array) -> tuple[Notice, ...]:
        """Give an identity to new tracks with enough evidence."""
        notices = []
        for k in np.flatnonzero(owners >= 0).tolist():
            t = owners[k]
            if self._tracks.ids[t] < 0 and (
                self._tracks.hits[t] >= self._config.confirm_frames or self._convinces(item, k)
            ):
                self._tracks.ids[t], self._next = self._next, self._next + 1
                number = int(self._tracks.ids[t])
                notices.append(
                    Notice("tracking.appeared", "info", f"person {number} appeared", {"id": number})
                )
        return tuple(notices)

    def _convinces(self, item: PoseSet, k: int) -> bool:
        """Whether a skeleton has enough views and joints to be confirmed at once."""
        measured = np.isfinite(item.positions[k, :, 0])
        agreed = measured & (item.views[k] >= 2)  # the others were inferred from these
        wanted = min(self._config.confirm_views, float(item.views.max()))
        enough = agreed.any() and item.views[k][agreed].mean() >= wanted
        return bool(enough and measured.mean() >= self._config.confirm_joints)

    def _compile(self) -> None:
        """Two instants of two people."""
        joints = len(self._skeleton)
        positions = np.random.default_rng(0).uniform(0.0, 1.0, (2, joints, 3))
        positions[1] += 9.0
        ones = np.ones((2, joints))
        covariances = np.tile(1e-4 * np.eye(3), (2, joints, 1, 1))
        for index in range(2):
            self.step(
                PoseSet(index, index, self._hash, positions, covariances, ones, 2 * ones, ones, np.ones(2))
            )


def _match(owners: Array, rows: Array, cost: Array) -> None:
    """Optimal assignment (Hungarian) over finite costs, which passed the gates; fills `owners` with rows."""
    if not cost.size:
        return
    for i, k in zip(*linear_sum_assignment(np.where(np.isfinite(cost), cost, FORBIDDEN))):
        if np.isfinite(cost[i, k]):
            owners[k] = rows[i]


def _as_images_show(item: PoseSet) -> PoseSet:
    """The skeletons with known biases of the detector: predictions are compared with images."""
    if item.corrections is None:
        return item
    return replace(item, positions=item.positions - item.corrections)


def _tracked(item: PoseSet, rows: Array, ids: Array) -> TrackedPoseSet:
    """The chosen skeletons with their ids."""
    everybody = np.array_equal(rows, np.arange(len(item.positions)))  # no need to copy then
    names = ("positions", "covariances", "scores", "views", "states", "person_scores")
    arrays = {name: getattr(item, name) if everybody else getattr(item, name)[rows] for name in names}
    shift, sources = item.time_shift, item.sources
    if not everybody:
        shift = None if shift is None else shift.rows(rows)
        sources = None if sources is None else sources.rows(rows)
    return TrackedPoseSet(
        item.index, item.stamp_ns, item.skeleton_hash, **arrays, newest_ns=item.newest_ns, time_shift=shift,
        sources=sources, ids=ids,
    )  # fmt: skip
