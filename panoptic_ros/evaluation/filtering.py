"""Standard skeleton filters, as baselines."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from panoptic_ros.domain import TrackedPoseSet
from panoptic_ros.evaluation.sequences import SkeletonFrame

Array = np.ndarray


def savitzky_golay(raw: Sequence[TrackedPoseSet], frames: int = 7, order: int = 2) -> list[SkeletonFrame]:
    """Filter every person's joints over `frames` frames after Savitzky and Golay 1964.

    Gaps of a joint are filled by linear interpolation for the filter and are missing again in the result. A
    person with fewer instants than `frames` is not filtered.
    """
    from scipy.signal import savgol_filter  # takes a second to load, and most runs do not need it

    found: list[dict[int, Array]] = [{} for _ in raw]
    for number, rows in _by_person(raw).items():
        points = np.array([row[1] for row in rows])
        for joint in range(points.shape[1]):
            known = np.flatnonzero(np.isfinite(points[:, joint, 0]))
            if len(known) and len(rows) >= frames:
                steps = np.arange(len(rows))
                filled = [np.interp(steps, known, points[known, joint, i]) for i in range(3)]
                smooth = savgol_filter(np.stack(filled, axis=1), frames, order, axis=0)
                points[known, joint] = smooth[known]
        for (k, _), places in zip(rows, points):
            found[k][number] = places
    return _frames(raw, found)


def one_euro(
    raw: Sequence[TrackedPoseSet], cutoff: float = 3.0, beta: float = 4.0, speed_cutoff: float = 1.0
) -> list[SkeletonFrame]:
    """Filter every person's joints with the causal filter of Casiez et al. 2012.

    A missing joint keeps its last position.

    Args:
        cutoff: Smallest cut-off frequency of the positions, Hz.
        beta: Increase of the cut-off frequency with speed, Hz per m/s.
        speed_cutoff: Cut-off frequency of the speed, Hz.
    """
    found: list[dict[int, Array]] = [{} for _ in raw]
    for number, rows in _by_person(raw).items():
        place = speed = np.full_like(rows[0][1], np.nan)
        last = raw[rows[0][0]].stamp_ns
        for k, points in rows:
            dt = max(1e-9 * (raw[k].stamp_ns - last), 1e-6)
            new, there = np.isnan(place[:, :1]), np.isfinite(points[:, :1])
            slow = 1.0 / (1.0 + 1.0 / (2.0 * np.pi * speed_cutoff * dt))
            now = np.where(new, 0.0, (points - place) / dt)
            followed = np.where(new, now, slow * now + (1.0 - slow) * np.nan_to_num(speed))
            speed = np.where(there, followed, speed)
            fast = cutoff + beta * np.linalg.norm(speed, axis=1, keepdims=True)
            share = 1.0 / (1.0 + 1.0 / (2.0 * np.pi * fast * dt))
            blended = np.where(new, points, share * points + (1.0 - share) * place)
            place, last = np.where(there, blended, place), raw[k].stamp_ns
            found[k][number] = place
    return _frames(raw, found)


def _by_person(raw: Sequence[TrackedPoseSet]) -> dict[int, list[tuple[int, Array]]]:
    """Return the frame indices and joints (J, 3) m of every person."""
    people: dict[int, list[tuple[int, Array]]] = {}
    for k, item in enumerate(raw):
        for number, points in zip(item.ids.tolist(), item.positions):
            people.setdefault(number, []).append((k, points))
    return people


def _frames(raw: Sequence[TrackedPoseSet], found: Sequence[dict[int, Array]]) -> list[SkeletonFrame]:
    return [
        SkeletonFrame(
            item.stamp_ns,
            np.array(list(own), np.int64),
            np.array(list(own.values())).reshape(-1, item.positions.shape[1], 3),
        )
        for item, own in zip(raw, found)
    ]
