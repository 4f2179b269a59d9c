"""The tracking stage."""
from __future__ import annotations

import numpy as np
from scipy.optimize import linear_sum_assignment

from panoptic_ros.domain import PoseSet, TrackedPoseSet
from panoptic_ros.errors import DataError
from panoptic_ros.stage import Notice, StageContext, StepResult
from panoptic_ros.state import Stateful, StateLayout
from panoptic_ros.tracking.config import TrackingConfig
from panoptic_ros.tracking.tracks import Track, head_distances, joint_distances, return_costs

Array = np.ndarray
FORBIDDEN = 1e6  # cost of pairs outside of the gates


class TrackingStage(Stateful):
    """Identities for the skeletons of a `PoseSet`."""

    LAYOUT = StateLayout(
        "tracking", ("_tracks", "_next", "_last_ns"), (Track,),
        same={"configuration": "_config", "skeleton": "_hash"},
    )  # fmt: skip

    def __init__(self, config: TrackingConfig, context: StageContext):
        self._config, self._skeleton = config, context.skeleton
        self._hash = context.skeleton.hash  # computed at each call
        self._bones = np.array(context.skeleton.bones, np.int64).reshape(-1, 2)
        self.reset()

    def reset(self) -> None:
        """Forget everybody; ids start from 0."""
        self._tracks: list[Track] = []
        self._next = 0
        self._last_ns: int | None = None

    def flush(self) -> StepResult[TrackedPoseSet]:
        """Nothing is buffered."""
        self.reset()
        return StepResult()

    def step(self, item: PoseSet) -> StepResult[TrackedPoseSet]:
        """The skeletons that have an identity; sets from the past are dropped with a notice.

        Raises:
            DataError: if the poses are of another skeleton.
        """
        if item.skeleton_hash != self._hash:
            raise DataError(
                f"poses of skeleton {item.skeleton_hash}, but tracking works on "
                f"{self._skeleton.name} ({self._hash})"
            )
        if self._last_ns is not None and item.stamp_ns <= self._last_ns:
            text = f"a set of stamp {item.stamp_ns} came after one of {self._last_ns}; it was dropped"
            return StepResult(notices=(Notice("tracking.old_stamp", "warning", text),))
        self._advance(item.stamp_ns)
        owners = self._assign(item)
        notices = self._update(item, owners)
        known = ((k, track.number) for k, track in enumerate(owners) if track is not None)
        numbers = {k: number for k, number in known if number >= 0}
        chosen = sorted(numbers, key=lambda k: numbers[k])
        return StepResult((_tracked(item, chosen, [numbers[k] for k in chosen]),), notices)

    def _advance(self, stamp_ns: int) -> None:
        """Predict all tracks to the instant, and drop those that were unseen for too long."""
        dt = 0.0 if self._last_ns is None else 1e-9 * (stamp_ns - self._last_ns)
        self._last_ns = stamp_ns
        for track in self._tracks:
            track.predict(dt, self._config.acceleration, self._config.joint_memory)
        self._tracks = [track for track in self._tracks if self._waits(track)]

    def _waits(self, track: Track) -> bool:
        """Whether a track is kept: confirmed ones for `memory`, others for `joint_memory`."""
        memory = self._config.memory if track.number >= 0 else self._config.joint_memory
        return track.unseen <= memory

    def _assign(self, item: PoseSet) -> list[Track | None]:
        """Association of skeletons and tracks: first by joints, then of people who come back."""
        config = self._config
        owners: list[Track | None] = [None] * len(item.positions)
        everybody = list(range(len(self._tracks)))
        if config.method == "head":
            distance = head_distances(self._tracks, item, self._skeleton.head)
            self._match(owners, everybody, np.where(distance <= config.max_distance, distance, np.inf))
            return owners
        distance, cost = joint_distances(self._tracks, item)
        self._match(owners, everybody, np.where(distance <= config.max_distance, cost, np.inf))
        waiting = [i for i, t in enumerate(self._tracks) if t.number >= 0 and not _among(t, owners)]
        lost = [self._tracks[i] for i in waiting]
        distance, difference = return_costs(lost, item, self._bones)
        reach = np.array([config.return_distance + config.return_speed * t.unseen for t in lost])
        allowed = (distance <= reach.reshape(-1, 1)) & (difference <= config.bone_tolerance)
        score = distance / np.maximum(reach.reshape(-1, 1), 1e-9) + difference / config.bone_tolerance
        taken = np.array([owner is not None for owner in owners], bool)
        self._match(owners, waiting, np.where(allowed & ~taken, score, np.inf))
        return owners

    def _match(self, owners: list[Track | None], rows: list[int], cost: Array) -> None:
        """Optimal assignment (Hungarian) over finite costs, which passed the gates; fills `owners`."""
        if not cost.size:
            return
        for i, k in zip(*linear_sum_assignment(np.where(np.isfinite(cost), cost, FORBIDDEN))):
            if np.isfinite(cost[i, k]) and owners[k] is None:
                owners[k] = self._tracks[rows[i]]

    def _update(self, item: PoseSet, owners: list[Track | None]) -> tuple[Notice, ...]:
        """Update tracks, start new ones, and confirm those with enough evidence."""
        notices = []
        for k in range(len(owners)):
            track = owners[k]
            if track is None:
                if self._is_duplicate(item, k, owners) or not np.isfinite(item.positions[k, :, 0]).any():
                    continue
                track = owners[k] = Track.empty(len(self._skeleton), len(self._bones))
                self._tracks.append(track)
            track.update(item.positions[k], item.covariances[k], self._bones)
            if np.isfinite(item.positions[k, self._skeleton.head, 0]):
                track.head = item.positions[k, self._skeleton.head]
            if track.number < 0 and (self._convinces(item, k) or track.hits >= self._config.confirm_frames):
                track.number, self._next = self._next, self._next + 1
                text = f"person {track.number} appeared"
                notices.append(Notice("tracking.appeared", "info", text, {"id": track.number}))
        return tuple(notices)

    def _convinces(self, item: PoseSet, k: int) -> bool:
        """Whether a skeleton has enough views and joints to be confirmed at once."""
        measured = np.isfinite(item.positions[k, :, 0])
        agreed = measured & (item.views[k] >= 2)  # the others were inferred from these
        wanted = min(self._config.confirm_views, float(item.views.max()))
        enough = agreed.any() and item.views[k][agreed].mean() >= wanted
        return bool(enough and measured.mean() >= self._config.confirm_joints)

    def _is_duplicate(self, item: PoseSet, k: int, owners: list[Track | None]) -> bool:
        """Whether a skeleton without a track is at the place of one that has a track."""
        for other, owner in enumerate(owners):
            if owner is None or other == k:
                continue
            gaps = np.linalg.norm(item.positions[k] - item.positions[other], axis=-1)
            known = np.isfinite(gaps)
            if known.sum() >= 3 and gaps[known].mean() < self._config.duplicate_distance:
                return True
        return False


def _among(track: Track, owners: list[Track | None]) -> bool:
    return any(owner is track for owner in owners)


def _tracked(item: PoseSet, rows: list[int], ids: list[int]) -> TrackedPoseSet:
    """The chosen skeletons with their ids."""
    return TrackedPoseSet(
        item.index, item.stamp_ns, item.skeleton_hash, item.positions[rows], item.covariances[rows],
        item.scores[rows], item.views[rows], item.states[rows], item.person_scores[rows],
        item.newest_ns, None if item.time_shift is None else item.time_shift.rows(rows),
        None if item.sources is None else item.sources.rows(rows),
        ids=np.array(ids, np.int64),
    )  # fmt: skip
