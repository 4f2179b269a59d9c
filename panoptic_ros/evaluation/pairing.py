"""Assignment of result people to truth people, frame by frame.

Frames: every truth frame is paired with the result frame of the nearest timestamp, within half a frame
period. A result frame is used once. The truth is interpolated to the result's timestamp by a cubic spline per
person.

People: they are assigned by the Hungarian method on the mean distance over common joints (at least
`MIN_COMMON`). Pairs above `GATE` are dropped. Truth people marked as ignored are left out of all scores. A
result is left out if it matches an ignored person, or if it matches no person and is within the gate of an
ignored person.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from panoptic_ros.evaluation.sequences import SkeletonFrame, SkeletonSequence

Array = np.ndarray

GATE = 0.5  # m; largest mean distance of a match
FOUND = 0.15  # m; a match below this mean distance is treated as a found person
MIN_COMMON = 3  # smallest number of common joints of a match
MIN_TRACK = 4  # smallest number of frames for a cubic spline
_LONE_FRAME_NS = 5e8  # ns; largest timestamp difference if there is only one truth frame
_FORBIDDEN = 1e3  # m; cost of a pair that cannot be a match


@dataclass(frozen=True, slots=True, eq=False)
class FramePair:
    """One truth frame with its result frame, without ignored people.

    Letters: T truth people, R result people, M matches.
    """

    stamp_ns: int  # timestamp of the result, or of the truth if there is no result
    offset_ns: int | None  # result minus truth; None if there is no result
    truth_ids: Array  # (T,)
    truth: Array  # (T, J, 3) m at stamp_ns
    result_ids: Array  # (R,)
    result: Array  # (R, J, 3) m
    covariances: Array  # (R, J, 3, 3) m^2
    views: Array  # (R, J) number of views that measured each joint, see `SkeletonFrame`
    matches: Array  # (M, 2) rows of truth and result
    distances: Array  # (M, J) m, NaN where either joint is missing

    @property
    def means(self) -> Array:
        """Return the mean joint distance (M,) m of every match."""
        means: Array = np.nanmean(self.distances, axis=1)
        return means

    @property
    def found(self) -> Array:
        """Return a mask (M,) of matches that are treated as a found person."""
        return self.means < FOUND

    @property
    def match_ids(self) -> list[tuple[int, int]]:
        """Return the ids (truth, result) of the matches."""
        return [(int(self.truth_ids[t]), int(self.result_ids[r])) for t, r in self.matches]


def pair_sequences(truth: SkeletonSequence, result: SkeletonSequence, skip: int = 0) -> list[FramePair]:
    """Return all truth frames but the first `skip`, each paired with its result; see `pairs_in_turn`."""
    return list(pairs_in_turn(truth, result, skip))


def pairs_in_turn(truth: SkeletonSequence, result: SkeletonSequence, skip: int = 0) -> Iterator[FramePair]:
    """Yield all truth frames but the first `skip` in order, each paired with its result.

    Joints are matched by name; joints that the result lacks are missing.

    Raises:
        DataError: If truth and result have no joint in common.
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
    """Return for each truth stamp (T,), in order, the index of its paired result stamp (R,), or None."""
    if not len(truth_stamps):
        return []
    limit = np.diff(truth_stamps).min() / 2 if len(truth_stamps) > 1 else _LONE_FRAME_NS
    best: dict[int, tuple[int, int]] = {}  # truth frame -> (offset, result frame)
    after = np.clip(np.searchsorted(truth_stamps, result_stamps), 1, max(len(truth_stamps) - 1, 1))
    around = np.stack([after - 1, np.minimum(after, len(truth_stamps) - 1)])
    offsets = np.abs(truth_stamps[around] - result_stamps)
    nearest = offsets.argmin(axis=0)  # the earlier of two equally near frames
    for k, side in enumerate(nearest):
        i, offset = int(around[side, k]), int(offsets[side, k])
        if offset <= limit and (i not in best or offset < best[i][0]):
            best[i] = (offset, k)
    return [best[i][1] if i in best else None for i in range(len(truth_stamps))]


class TruthMotion:
    """Spline interpolation of the true joints of all people, near the truth's frames."""

    def __init__(self, truth: SkeletonSequence):
        self._origin = truth.frames[0].stamp_ns if truth.frames else 0
        rows: dict[int, list[tuple[float, Array]]] = {}
        for frame in truth.frames:
            for number, joints in zip(frame.ids.tolist(), frame.positions):
                rows.setdefault(number, []).append((self._seconds(frame.stamp_ns), joints))
        from scipy.interpolate import CubicSpline  # takes long to load, and most runs do not need it

        self._splines: dict[int, CubicSpline] = {}
        for number, track in rows.items():
            times, joints = (np.array(column) for column in zip(*track))
            if len(track) >= MIN_TRACK and not np.isnan(joints).any() and (np.diff(times) > 0).all():
                self._splines[number] = CubicSpline(times, joints)

    def _seconds(self, stamp_ns: int) -> float:
        return (stamp_ns - self._origin) * 1e-9

    def at(self, number: int, stamp_ns: int) -> Array | None:
        """Return the joints (J, 3) m of a person at a timestamp; None without a spline for this person."""
        spline = self._splines.get(number)
        return None if spline is None else spline(self._seconds(stamp_ns))

    def moved(self, frame: SkeletonFrame, stamp_ns: int) -> Array:
        """Return the frame's people (P, J, 3) m at another timestamp; unchanged if they have no spline."""
        if stamp_ns == frame.stamp_ns:
            return frame.positions
        moved = frame.positions.copy()
        for row, number in enumerate(frame.ids.tolist()):
            joints = self.at(number, stamp_ns)
            if joints is not None:
                moved[row] = joints
        return moved


def distance_table(truth: Array, result: Array) -> tuple[Array, Array, Array]:
    """Return distances (T, R, J) m, their means (T, R) m or inf, and the number of common joints (T, R)."""
    distances = np.linalg.norm(truth[:, None] - result[None], axis=-1)
    common = (~np.isnan(distances)).sum(-1)
    means = np.nansum(distances, axis=-1) / np.maximum(common, 1)
    return distances, np.where(common > 0, means, np.inf), common


def match_people(truth: Array, result: Array) -> tuple[Array, Array]:
    """Return matches (M, 2) between people (T, J, 3) and (R, J, 3), and their distances (M, J) m."""
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
    """Return a mask (R,) of results that are within the gate of any of the people (P, J, 3)."""
    if not len(people) or not len(result):
        return np.zeros(len(result), bool)
    near: Array = np.any(distance_table(people, result)[1] <= GATE, axis=0)
    return near


def _renumber(kept: Array) -> Array:
    """Return the new row of each kept row, for a mask (N,)."""
    return np.cumsum(kept) - 1
