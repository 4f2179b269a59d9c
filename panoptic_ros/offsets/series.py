"""Observations in the order of trajectories: one per person and joint, cut where nobody saw it for long."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from panoptic_ros.offsets.association import Observations
from panoptic_ros.offsets.trajectories import SPAN

Array = np.ndarray
KNOTS = 0.08  # s
LONGEST_GAP = 0.5  # s without any ray; after a longer gap a trajectory begins anew
LEAST_RAYS = 12  # of a trajectory
MARGIN = 0.1  # s of spline beyond the outermost rays, as clocks may still move


@dataclass(frozen=True, slots=True, eq=False)
class Series:
    """S trajectories: first ray (S + 1,), first instant (S,) s and number of control points (S,)."""

    starts: Array
    origins: Array
    counts: Array
    seen: Observations


def make_series(seen: Observations) -> Series:
    """Sort rays into trajectories; those with too few rays, or rays of one camera only, are left out."""
    order = np.lexsort((seen.stamp, seen.joint, seen.track))
    track, joint, stamp = seen.track[order], seen.joint[order], seen.stamp[order]
    begins = np.ones(len(order), bool)
    begins[1:] = (track[1:] != track[:-1]) | (joint[1:] != joint[:-1])
    begins[1:] |= stamp[1:] - stamp[:-1] > LONGEST_GAP
    kept = [
        order[first:last]
        for first, last in _runs(begins)
        if last - first >= LEAST_RAYS and len(np.unique(seen.camera[order[first:last]])) >= 2
    ]
    starts = np.concatenate([[0], np.cumsum([len(rays) for rays in kept])]).astype(np.int64)
    first = np.array([seen.stamp[rays[0]] - MARGIN for rays in kept])
    last = np.array([seen.stamp[rays[-1]] + MARGIN for rays in kept])
    counts = np.ceil((last - first) / KNOTS).astype(np.int64) + SPAN - 1
    rays = np.concatenate([np.empty(0, np.int64), *kept])
    fields = {name: getattr(seen, name)[rays] for name in Observations.__slots__}
    return Series(starts, first, counts, Observations(**fields))


def _runs(begins: Array) -> list[tuple[int, int]]:
    first = np.flatnonzero(begins)
    return list(zip(first.tolist(), [*first[1:].tolist(), len(begins)]))
