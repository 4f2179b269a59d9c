"""Usual filters of skeletons, to compare with."""
from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.signal import savgol_filter

from panoptic_ros.domain import TrackedPoseSet
from panoptic_ros.evaluation.sequences import SkeletonFrame

Array = np.ndarray


def savitzky_golay(raw: Sequence[TrackedPoseSet], frames: int = 7, order: int = 2) -> list[SkeletonFrame]:
    """Every person's joints under the filter of Savitzky and Golay 1964 over so many frames.

    Where a joint is missing it is put in by a line, filtered over, and missing again.
    """
    people: dict[int, list[tuple[int, Array]]] = {}
    for k, item in enumerate(raw):
        for number, points in zip(item.ids.tolist(), item.positions):
            people.setdefault(number, []).append((k, points))
    found: list[dict[int, Array]] = [{} for _ in raw]
    for number, rows in people.items():
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
    return [
        SkeletonFrame(
            item.stamp_ns, np.array(list(own), np.int64),
            np.array(list(own.values())).reshape(-1, item.positions.shape[1], 3),
        )
        for item, own in zip(raw, found)
    ]  # fmt: skip
