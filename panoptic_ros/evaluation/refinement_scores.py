"""Scores that smoothing can change: time-varying errors, and smoothness of motion.

A detector's joint definitions differ from those of the truth. The difference is a constant offset of each
joint of a person in the torso frame. Smoothing does not change this offset, so these scores remove it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from panoptic_ros.errors import DataError
from panoptic_ros.evaluation.motion_scores import acceleration_error
from panoptic_ros.evaluation.pairing import FramePair
from panoptic_ros.geometry.torso import torso_frames

Array = np.ndarray
TORSO = ("lShoulder", "rShoulder", "lHip", "rHip")
FAST = 1.0  # m/s; true speed above which a joint is treated as fast
PCK_M = 0.1


def refinement_scores(pairs: Sequence[FramePair], joint_names: Sequence[str]) -> dict[str, float]:
    """Return scores of results against their truth by name; NaN where nothing counts.

    acceleration_error: See `acceleration_error`, m/s^2. mpjpe_mm: Mean error. offset_free_mm,
    offset_free_p95_mm: Mean and 95th percentile of the error without its constant offset. This offset is the
    mean error over all pairs, per person and joint, in the truth's torso frame. fast_mm: As
    offset_free_mm, of joints whose true speed is above 1 m/s. pck_10cm: Share of the truth's joints with an
    error below 10 cm.

    Raises:
        DataError: If the truth lacks shoulders or hips.
    """
    missing = [name for name in TORSO if name not in joint_names]
    if missing:
        raise DataError(f"the truth has no joint {missing[0]}; offsets are given in the frame of the torso")
    corners = [list(joint_names).index(name) for name in TORSO]
    speeds = _speeds(pairs)
    errors: dict[int, list[Array]] = {}
    moving: dict[int, list[Array]] = {}
    for k, pair in enumerate(pairs):
        for (person, _), (row, column) in zip(pair.match_ids, pair.matches):
            axes, _ = torso_frames(pair.truth[row, corners])
            errors.setdefault(person, []).append((pair.result[column] - pair.truth[row]) @ axes)
            moving.setdefault(person, []).append(speeds[k].get(person, np.full(len(joint_names), np.nan)))
    free, fast, plain = [np.zeros(0)], [np.zeros(0)], [np.zeros(0)]
    for person, found in errors.items():
        own = np.array(found)
        there = np.isfinite(own[..., 0])
        offsets = np.where(there[..., None], own, 0.0).sum(axis=0) / np.maximum(there.sum(axis=0), 1)[:, None]
        rest = np.linalg.norm(own - offsets, axis=-1)
        plain.append(np.linalg.norm(own[there], axis=-1))
        free.append(rest[there])
        fast.append(rest[there & (np.array(moving[person]) > FAST)])
    errors_mm, free_mm, fast_mm = (1e3 * np.concatenate(values) for values in (plain, free, fast))
    count = sum(int(np.isfinite(pair.truth[..., 0]).sum()) for pair in pairs)
    near = sum(int((pair.distances < PCK_M).sum()) for pair in pairs)
    nothing = float("nan")
    return {
        "acceleration_error": acceleration_error(pairs),
        "mpjpe_mm": float(errors_mm.mean()) if len(errors_mm) else nothing,
        "offset_free_mm": float(free_mm.mean()) if len(free_mm) else nothing,
        "offset_free_p95_mm": float(np.quantile(free_mm, 0.95)) if len(free_mm) else nothing,
        "fast_mm": float(fast_mm.mean()) if len(fast_mm) else nothing,
        "pck_10cm": near / count if count else nothing,
    }


def _speeds(pairs: Sequence[FramePair]) -> list[dict[int, Array]]:
    """Return the joint speeds (J,) m/s of the truth's people at every pair, by id.

    They are central differences, so the first and the last pair have none.
    """
    found: list[dict[int, Array]] = [{} for _ in pairs]
    places = [dict(zip(pair.truth_ids.tolist(), pair.truth)) for pair in pairs]
    for k in range(1, len(pairs) - 1):
        seconds = 1e-9 * (pairs[k + 1].stamp_ns - pairs[k - 1].stamp_ns)
        for person in places[k - 1].keys() & places[k + 1].keys():
            step = places[k + 1][person] - places[k - 1][person]
            found[k][person] = np.linalg.norm(step, axis=-1) / seconds
    return found
