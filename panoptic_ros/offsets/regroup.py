"""Regroup detection sets after a correction of the timestamps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from panoptic_ros.domain import DetectionSet, ViewDetections

Array = np.ndarray


def regroup(sets: Sequence[DetectionSet], corrections: Mapping[str, Array]) -> list[DetectionSet]:
    """Return new sets at the instants of `sets`, with the frames nearest to each instant after correction.

    Every frame is used at most once, and only within half of the median period of the sets. If two frames of
    a camera belong to one instant, the nearer one is used. Frames with negative corrected timestamps are
    dropped.

    Args:
        sets: sets in time order.
        corrections: (K,) ns by camera, to add to the timestamps of the camera's K frames, in the order of
            the sets.
    """
    instants = np.array([item.stamp_ns for item in sets], np.int64)
    chosen: list[dict[str, ViewDetections]] = [{} for _ in sets]
    half = 0.5 * float(np.median(np.diff(instants))) if len(instants) > 1 else np.inf
    seen: dict[str, int] = {}
    distance: dict[tuple[int, str], float] = {}
    for item in sets:
        for view in item.views:
            k = seen.get(view.camera, 0)
            seen[view.camera] = k + 1
            stamp = view.stamp_ns + round(float(corrections[view.camera][k]))
            if stamp < 0:
                continue
            after = int(np.searchsorted(instants, stamp))
            near = min(
                (i for i in (after - 1, after) if 0 <= i < len(sets)),
                key=lambda i: abs(int(instants[i]) - stamp),
            )
            miss = abs(int(instants[near]) - stamp)
            if miss <= half and miss < distance.get((near, view.camera), np.inf):
                distance[near, view.camera] = miss
                chosen[near][view.camera] = replace(view, stamp_ns=stamp)
    order = list(dict.fromkeys(view.camera for item in sets for view in item.views))
    return [
        replace(item, views=tuple(views[name] for name in order if name in views))
        for item, views in zip(sets, chosen)
    ]
