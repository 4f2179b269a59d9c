"""Who in the result is whom in the truth, frame by frame.

Frames: every truth frame is paired with the result frame of the nearest stamp, within half a frame
period; a result frame is used once. The truth is moved to the result's stamp by a cubic spline per
person. People: Hungarian assignment on the mean distance over the joints that both have (at
least `MIN_COMMON`); pairs above `GATE` are dropped. Truth that is to be ignored does not count, nor do
results that match it, or that match nobody and are within the gate of it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from panoptic_ros.evaluation.sequences import SkeletonFrame, SkeletonSequence

Array = np.ndarray

GATE = 0.5  # m, largest mean distance of a match
FOUND = 0.15  # m, a match below this mean distance counts as a person found
MIN_COMMON = 3  # joints that a match must share
MIN_TRACK = 4  # frames that a cubic spline needs
_LONE_FRAME_NS = 5e8  # how far apart the stamps may be if there is only one truth frame
_FORBIDDEN = 1e3  # m, cost of a pair that is no match


@dataclass(frozen=True, slots=True, eq=False)
class FramePair:
    """One truth frame with its result frame, without what is to be ignored.

    Letters: T people of the truth, R of the result, M matches.
    """

    stamp_ns: int  # of the result, or of the truth if there is no result
    offset_ns: int | None  # result minus truth; None if there is no result
    truth_ids: Array  # (T,)
    truth: Array  # (T, J, 3) m at stamp_ns
    result_ids: Array  # (R,)
    result: Array  # (R, J, 3) m
    covariances: Array  # (R, J, 3, 3) m^2
    views: Array  # (R, J) that measured each joint, see `SkeletonFrame`
    matches: Array  # (M, 2) rows of truth and result
    distances: Array  # (M, J) m, NaN where either joint is missing

    @property
    def means(self) -> Array:
        """Mean joint distance of every match (M,), m."""
        means: Array = np.nanmean(self.distances, axis=1)
        return means

    @property
    def found(self) -> Array:
        """Which matches (M,) count as a person found."""
        return self.means < FOUND

    @property
    def match_ids(self) -> list[tuple[int, int]]:
        """Ids (truth, result) of the matches."""
        return [(int(self.truth_ids[t]), int(self.result_ids[r])) for t, r in self.matches]


def pair_sequences(truth: SkeletonSequence, result: SkeletonSequence, skip: int = 0) -> list[FramePair]:
    """All truth frames but the first `skip`, each paired with its result; see `pairs_in_turn`."""
    return list(pairs_in_turn(truth, result, skip))


def pairs_in_turn(truth: SkeletonSequence, result: SkeletonSequence, skip: int = 0) -> Iterator[FramePair]:
    """All truth frames but the first `skip`, one after another, each paired with its result.

    The result needs joints of the truth's names; joints that it lacks are missing.

    Raises:
        DataError: if truth and result have no joint in common.
    """
    result = result.with_joints(truth.joint_names)
    partners = nearest_frames(
        np.array([frame.stamp_ns for frame in truth.frames], np.int64),
        np.array([frame.stamp_ns for frame in result.frames], np.int64),
    )
    motion = TruthMotion(truth)
    for frame, partner in list(zip(truth.frames, partners))[skip:]:
        yield _pair(motion, frame, None if partner is None else result.frames[partner])


def nearest_frames(truth_stamps: Array, result_stamps: Array) -> list[int | None]:
    """For every truth stamp (T,), in order, the index of the result stamp (R,) paired with it, or None."""
    if not len(truth_stamps):
        return []
    limit = np.diff(truth_stamps).min() / 2 if len(truth_stamps) > 1 else _LONE_FRAME_NS
    best: dict[int, tuple[int, int]] = {}  # truth frame -> offset, result frame
    after = np.clip(np.searchsorted(truth_stamps, result_stamps), 1, max(len(truth_stamps) - 1, 1))
    around = np.stack([after - 1, np.minimum(after, len(truth_stamps) - 1)])
    offsets = np.abs(truth_stamps[around] - result_stamps)
    nearest = offsets.argmin(axis=0)  # the earlier one of two
    for k, side in enumerate(nearest):
        i, offset = int(around[side, k]), int(offsets[side, k])
        if offset <= limit and (i not in best or offset < best[i][0]):
            best[i] = (offset, k)
    return [best[i][1] if i in best else None for i in range(len(truth_stamps))]


class TruthMotion:
    """The true joints of everybody as functions of time, near the truth's frames."""

    def __init__(self, truth: SkeletonSequence):
        self._origin = truth.frames[0].stamp_ns if truth.frames else 0
        rows: dict[int, list[tuple[float, Array]]] = {}
        for frame in truth.frames:
            for number, joints in zip(frame.ids.tolist(), frame.positions):
                rows.setdefault(number, []).append((self._seconds(frame.stamp_ns), joints))
        from scipy.interpolate import CubicSpline  # takes long to load, which runs do not need

        self._splines: dict[int, CubicSpline] = {}
        for number, track in rows.items():
            times, joints = (np.array(column) for column in zip(*track))
            if len(track) >= MIN_TRACK and not np.isnan(joints).any() and (np.diff(times) > 0).all():
                self._splines[number] = CubicSpline(times, joints)

    def _seconds(self, stamp_ns: int) -> float:
        return (stamp_ns - self._origin) * 1e-9

    def at(self, number: int, stamp_ns: int) -> Array | None:
        """Joints (J, 3) of a person at a stamp; None if too few frames show the whole person."""
        spline = self._splines.get(number)
        return None if spline is None else spline(self._seconds(stamp_ns))

    def moved(self, frame: SkeletonFrame, stamp_ns: int) -> Array:
        """The frame's people (P, J, 3) at another stamp; unchanged if they cannot be moved."""
        if stamp_ns == frame.stamp_ns:
            return frame.positions
        moved = frame.positions.copy()
        for row, number in enumerate(frame.ids.tolist()):
            joints = self.at(number, stamp_ns)
            if joints is not None:
                moved[row] = joints
        return moved


def distance_table(truth: Array, result: Array) -> tuple[Array, Array, Array]:
    """Distances (T, R, J) m, their means (T, R) m or inf, and how many joints are common (T, R)."""
    distances = np.linalg.norm(truth[:, None] - result[None], axis=-1)
    common = (~np.isnan(distances)).sum(-1)
    means = np.nansum(distances, axis=-1) / np.maximum(common, 1)
    return distances, np.where(common > 0, means, np.inf), common


def match_people(truth: Array, result: Array) -> tuple[Array, Array]:
    """Matches (M, 2) between people (T, J, 3) and (R, J, 3), and their distances (M, J) m."""
    joints = truth.shape[1]
    if not len(truth) or not len(result):
        return np.empty((0, 2), np.int64), np.empty((0, joints))
    distances, means, common = distance_table(truth, result)
    allowed = (common >= MIN_COMMON) & (means <= GATE)
    rows, columns = linear_sum_assignment(np.where(allowed, means, _FORBIDDEN))
    kept = allowed[rows, columns]
    rows, columns = rows[kept], columns[kept]
    return np.stack([rows, columns], axis=-1), distances[rows, columns]


def _pair(motion: TruthMotion, truth: SkeletonFrame, result: SkeletonFrame | None) -> FramePair:
    counted = ~truth.ignored
    if result is None:
        nobody = SkeletonFrame(truth.stamp_ns, np.empty(0), np.empty((0, *truth.positions.shape[1:])))
        return FramePair(
            truth.stamp_ns,
            None,
            truth.ids[counted],
            truth.positions[counted],
            nobody.ids,
            nobody.positions,
            nobody.covariances,
            nobody.views,
            np.empty((0, 2), np.int64),
            np.empty((0, truth.positions.shape[1])),
        )
    people = motion.moved(truth, result.stamp_ns)
    matches, distances = match_people(people, result.positions)
    scored = counted[matches[:, 0]]
    matches, distances = matches[scored], distances[scored]
    kept = ~_near(result.positions, people[truth.ignored])
    kept[matches[:, 1]] = True
    matches = np.stack([_renumber(counted)[matches[:, 0]], _renumber(kept)[matches[:, 1]]], axis=-1)
    return FramePair(
        result.stamp_ns,
        result.stamp_ns - truth.stamp_ns,
        truth.ids[counted],
        people[counted],
        result.ids[kept],
        result.positions[kept],
        result.covariances[kept],
        result.views[kept],
        matches,
        distances,
    )


def _near(result: Array, people: Array) -> Array:
    """Which results (R,) are within the gate of any of the people (P, J, 3)."""
    if not len(people) or not len(result):
        return np.zeros(len(result), bool)
    near: Array = np.any(distance_table(people, result)[1] <= GATE, axis=0)
    return near


def _renumber(kept: Array) -> Array:
    """New row of each kept row, for a mask (N,)."""
    return np.cumsum(kept) - 1
