"""Constant offset of the result's clock, estimated from the motion."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from panoptic_ros.errors import DataError
from panoptic_ros.evaluation.pairing import TruthMotion, match_people, nearest_frames
from panoptic_ros.evaluation.sequences import SkeletonSequence

Array = np.ndarray


@dataclass(frozen=True, slots=True)
class TimeOffset:
    """Offset to add to the result's timestamps, s, and the median joint error, m, without and with it."""

    seconds: float
    error_before: float
    error_after: float


def find_time_offset(
    truth: SkeletonSequence, result: SkeletonSequence, largest: float = 0.5, step: float = 0.01
) -> TimeOffset:
    """Return the shift of the result's timestamps, within +- `largest` s, that fits the truth best.

    People are matched at the unshifted timestamps. The truth's splines are then evaluated at shifted
    timestamps. The median distance is scanned in steps of `step` s, and its minimum is refined.

    Raises:
        DataError: If no person of the result matches a truth person with a spline.
    """
    from scipy.optimize import minimize_scalar  # takes long to load, and most runs do not need it

    motion = TruthMotion(truth)
    tracks = _matched_tracks(motion, truth, result.with_joints(truth.joint_names))
    if not tracks:
        raise DataError("the time offset cannot be found: no person of the result is near the truth")
    inside = (truth.frames[0].stamp_ns, truth.frames[-1].stamp_ns)

    def error(seconds: float) -> float:
        shift = round(seconds * 1e9)
        distances = [
            np.linalg.norm(motion.at(who, stamp + shift) - joints, axis=-1)
            for who, stamp, joints in tracks
            if inside[0] <= stamp + shift <= inside[1]
        ]
        return float(np.nanmedian(distances)) if distances else np.inf

    grid = np.arange(-round(largest / step), round(largest / step) + 1) * step
    start = float(grid[np.argmin([error(seconds) for seconds in grid])])
    best = minimize_scalar(error, bounds=(start - step, start + step), method="bounded")
    return TimeOffset(float(best.x), error(0.0), float(best.fun))


def shifted(sequence: SkeletonSequence, seconds: float) -> SkeletonSequence:
    """Return the same skeletons with all timestamps shifted by `seconds`."""
    shift = round(seconds * 1e9)
    frames = tuple(replace(frame, stamp_ns=frame.stamp_ns + shift) for frame in sequence.frames)
    return SkeletonSequence(sequence.joint_names, frames)


def _matched_tracks(
    motion: TruthMotion, truth: SkeletonSequence, result: SkeletonSequence
) -> list[tuple[int, int, Array]]:
    """Return (truth id, timestamp, joints (J, 3)) of every matched skeleton of the result."""
    stamps = (np.array([f.stamp_ns for f in s.frames], np.int64) for s in (truth, result))
    tracks = []
    for frame, partner in zip(truth.frames, nearest_frames(*stamps)):
        if partner is None:
            continue
        seen = result.frames[partner]
        people = motion.moved(frame, seen.stamp_ns)
        for row, column in match_people(people, seen.positions)[0]:
            who = int(frame.ids[row])
            if not frame.ignored[row] and motion.at(who, seen.stamp_ns) is not None:
                tracks.append((who, seen.stamp_ns, seen.positions[column]))
    return tracks
