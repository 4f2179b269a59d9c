"""Figures of the study `continuous`: errors by time and speed, ellipsoids, identities, missing people."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from panoptic_ros.evaluation import SkeletonFrame, SkeletonSequence, pair_sequences
from panoptic_ros.evaluation.ellipsoids import ELLIPSOID_95, squared_distances
from panoptic_ros.evaluation.pairing import FramePair
from panoptic_ros.simulation.free_running import START_NS, FreeRunningCapture
from panoptic_ros.simulation.skeleton import JOINTS

Array = np.ndarray
SPEEDS = (0.0, 1.0, 2.0, 4.0, 8.0, 16.0)  # m/s, limits of the groups of speed
SKIPPED_S = 0.3  # s after a person enters and before it leaves, without a score of errors
LINGER_S = 0.5  # s before a person enters and after it leaves, in which output of it is not a fault
LAST = 0.75  # share of the capture after which the last quarter begins
MIXED_S = 0.3  # s with a second true person from which an id follows two people
LIMBS = tuple(  # pairs of joints whose distance is a bone
    (JOINTS.index(side + first), JOINTS.index(side + second))
    for side in "lr"
    for limb in (("Shoulder", "Elbow", "Wrist"), ("Hip", "Knee", "Ankle"))
    for first, second in pairwise(limb)
)
SPEED_STEP_S = 1e-3  # s, step of the difference that gives true speeds


def figures_of(capture: FreeRunningCapture, times: Array, frames: Sequence[SkeletonFrame]) -> dict[str, Any]:
    """Score people at instants (T,) s against the truth.

    Returns: errors in m and m/s^2; `bone_spread_m` is the standard deviation (m) of the length of a limb over
        time, a mean over limbs and people; `missing_s` is the longest time (s) of a present person without a
        result within `evaluation.pairing.FOUND`; `false_s` is the summed time (s) of people in the result at
        whose place there is no true person.
    """
    pairs = pair_sequences(truth_at(capture, times), SkeletonSequence(JOINTS, tuple(frames)))
    present, scored = capture.present(times), _scored(capture, times)
    step = 0.5 * SPEED_STEP_S
    joints = capture.joints(times)
    motion = capture.joints(times + step) - capture.joints(times - step)
    speeds = np.linalg.norm(motion, axis=-1) / SPEED_STEP_S
    errors = np.full(speeds.shape, np.nan)
    squares = np.full(speeds.shape, np.nan)
    places = np.full(joints.shape, np.nan)
    found = np.zeros(present.shape, bool)
    ids: dict[int, Counter[int]] = {}
    for t, pair in enumerate(pairs):
        for (row, column), gaps, near in zip(pair.matches.tolist(), pair.distances, pair.found):
            who = int(pair.truth_ids[row])
            errors[who, t] = gaps
            places[who, t] = pair.result[column]
            found[who, t] = near
            ids.setdefault(who, Counter())[int(pair.result_ids[column])] += 1
            squares[who, t] = squared_distances(
                pair.result[column] - pair.truth[row], pair.covariances[column]
            )
    for values in (errors, squares, places):
        values[~scored] = np.nan
    last = errors[:, times >= LAST * capture.scene.seconds]
    interval = float(np.median(np.diff(times)))
    return {
        "mean_m": _mean(errors),
        "last_m": _mean(last),
        "p95_m": float(np.nanpercentile(errors, 95)) if np.isfinite(errors).any() else np.nan,
        "by_speed_m": [_mean(errors[(speeds >= low) & (speeds < high)]) for low, high in pairwise(SPEEDS)],
        "acceleration_error": _mean(_bends(places - joints, interval)),
        "bone_spread_m": _bone_spread(places),
        "output": float(np.isfinite(errors[scored]).mean()),
        "in_ellipsoid": _share(squares),
        "in_ellipsoid_last": _share(squares[:, times >= LAST * capture.scene.seconds]),
        "ids": float(np.mean([len(ids.get(who, ())) for who in range(len(capture.people))])),
        "mixed_ids": _mixed(ids, interval),
        "missing_s": interval * max(_longest(there & ~near) for there, near in zip(present, found)),
        "missing": float((present & ~found).sum() / present.sum()),
        **_false(pairs, interval),
    }


def _bends(values: Array, interval: float) -> Array:
    """Return the norms (P, T - 2, J) of the second differences of values (P, T, J, 3), per s^2."""
    bends: Array = np.linalg.norm(np.diff(values, 2, axis=1), axis=-1) / interval**2
    return bends


def _bone_spread(places: Array) -> float:
    """Return the mean standard deviation (m) of the lengths of limbs over time, from joints (P, T, J, 3)."""
    first, second = np.array(LIMBS).T
    lengths = np.linalg.norm(places[:, :, first] - places[:, :, second], axis=-1).swapaxes(1, 2)
    spreads = [np.nanstd(own) for own in lengths.reshape(-1, lengths.shape[-1]) if np.isfinite(own).any()]
    return float(np.mean(spreads)) if spreads else np.nan


def truth_at(capture: FreeRunningCapture, times: Array) -> SkeletonSequence:
    """Return the true people at instants (T,) s; those who have just left or will come soon are ignored."""
    joints, present = capture.joints(times), capture.present(times)
    near = capture.present(times - LINGER_S) | capture.present(times + LINGER_S) | present
    frames = []
    for t, seconds in enumerate(times):
        rows = np.flatnonzero(near[:, t])
        stamp = START_NS + round(1e9 * float(seconds))
        frames.append(SkeletonFrame(stamp, rows, joints[rows, t], ignored=~present[rows, t]))
    return SkeletonSequence(JOINTS, tuple(frames))


def _scored(capture: FreeRunningCapture, times: Array) -> Array:
    """Return a mask (P, T) of the instants at which errors of a person are scored."""
    inside = (times >= SKIPPED_S) & (times <= capture.scene.seconds - SKIPPED_S)
    before, after = capture.present(times - SKIPPED_S), capture.present(times + SKIPPED_S)
    scored: Array = capture.present(times) & before & after & inside
    return scored


def _false(pairs: Sequence[FramePair], interval: float) -> dict[str, Any]:
    """Return the time (s) of unmatched result people, and the number of ids that are mostly unmatched."""
    right: Counter[int] = Counter()
    wrong: Counter[int] = Counter()
    for pair in pairs:
        matched = set(pair.matches[:, 1].tolist())
        for row, number in enumerate(pair.result_ids.tolist()):
            (right if row in matched else wrong)[number] += 1
    return {
        "false_s": interval * sum(wrong.values()),
        "false_people": sum(count > right[number] for number, count in wrong.items()),
    }


def _mixed(ids: Mapping[int, Counter[int]], interval: float) -> int:
    """Return the number of result ids that follow two true people, given the counts of ids by true person."""
    people = Counter(number for own in ids.values() for number, n in own.items() if n * interval >= MIXED_S)
    return sum(count > 1 for count in people.values())


def _longest(mask: Array) -> int:
    """Return the length of the longest run of True in a mask (T,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return int((edges[1::2] - edges[::2]).max(initial=0))


def _mean(values: Array) -> float:
    return float(np.nanmean(values)) if np.isfinite(values).any() else np.nan


def _share(squares: Array) -> float:
    known = squares[np.isfinite(squares)]
    return float((known < ELLIPSOID_95).mean()) if len(known) else np.nan
