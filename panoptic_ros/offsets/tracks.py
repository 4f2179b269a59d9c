"""Interpolate tracked persons between the instants of their sets."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from panoptic_ros.domain import TrackedPoseSet

Array = np.ndarray
LONGEST_GAP = 0.25  # s, maximum time between two instants for linear interpolation
BEYOND = 0.12  # s before the first and after the last instant in which the nearest pose is used


class TrackInterpolation:
    """Joint positions of persons at any instant, by linear interpolation between the instants of the sets.

    Args:
        reference_ns: (ns) time that is 0 s here.
    """

    def __init__(self, sets: Iterable[TrackedPoseSet], reference_ns: int):
        times: dict[int, list[float]] = {}
        positions: dict[int, list[Array]] = {}
        for item in sets:
            now = 1e-9 * (item.stamp_ns - reference_ns)
            for person, joints in zip(item.ids, item.positions):
                times.setdefault(int(person), []).append(now)
                positions.setdefault(int(person), []).append(joints)
        self.ids = sorted(times)
        self._times = [np.array(times[i]) for i in self.ids]
        self._positions = [np.stack(positions[i]) for i in self.ids]

    def at(self, time: float) -> tuple[Array, Array]:
        """Return the persons present at a time: rows (P,) of `ids`, and joints (P, J, 3) m or NaN."""
        rows, places = [], []
        for row, (times, positions) in enumerate(zip(self._times, self._positions)):
            if not times[0] - BEYOND <= time <= times[-1] + BEYOND:
                continue
            after = int(np.searchsorted(times, time))
            before, after = max(after - 1, 0), min(after, len(times) - 1)
            gap = times[after] - times[before]
            if gap > LONGEST_GAP:
                near = after if times[after] - time < time - times[before] else before
                if abs(times[near] - time) > BEYOND:
                    continue
                before = after = near
                gap = 0.0
            share = (time - times[before]) / gap if gap > 0.0 else 0.0
            first, second = positions[before], positions[after]
            joints = first + share * (second - first)
            rows.append(row)
            places.append(np.where(np.isnan(joints), np.where(np.isnan(first), second, first), joints))
        if not rows:
            return np.empty(0, np.int64), np.empty((0, 0, 3))
        return np.array(rows), np.stack(places)
