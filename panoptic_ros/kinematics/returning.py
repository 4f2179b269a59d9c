"""Somebody who was out of sight and comes back, maybe elsewhere, while others are there.

Whoever is seen while the subject is not is somebody else, and stays so as long as he can be followed. Who
appears besides, where several views agree and within what one can walk, is the subject.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from panoptic_ros.domain.subjects import Instant
from panoptic_ros.kinematics.evidence import Weighing
from panoptic_ros.kinematics.start import middle_of

Array = np.ndarray
People = dict[int, tuple[Array, Array]]
NEAR_RAYS, SAME = 0.25, 0.6  # m, between rays to the middle of one person; that somebody moves between looks
NEAR_PLACE = 1.0  # m, from where the subject is expected as it goes out of sight: may still be the subject
WALK, LOOKS = 3.0, 3  # m/s; looks in which a newcomer is seen before he counts
OTHERS_NS = 300_000_000  # of looking, in which all others are met; and between two sights of a newcomer


class Appearance(NamedTuple):
    """Where (3,) m the middle of somebody is, and his 2D people by camera."""

    place: Array
    people: People


class Absence:
    """One subject out of sight.

    Args:
        place: (3,) m, where it is expected as it goes. stamp_ns: of the last instant in which it was seen.
    """

    def __init__(self, place: Array, stamp_ns: int):
        self._place, self._stamp_ns = place, stamp_ns
        self._others: list[Array] = []
        self._first_ns = -1  # look
        self._newcomer = (place, 0, -1)  # place, looks, stamp of the last

    def look(self, appearances: list[Appearance], stamp_ns: int, gate: float) -> People:
        """The subject's 2D people, if it is back; of all who are nobody's.

        Args:
            gate: m, that the place may be off without any walking.
        """
        self._first_ns = stamp_ns if self._first_ns < 0 else self._first_ns
        new = self._without_others(appearances)
        if stamp_ns - self._first_ns < OTHERS_NS:
            self._others += [a.place for a in new if np.linalg.norm(a.place - self._place) > NEAR_PLACE]
            new = [a for a in new if np.linalg.norm(a.place - self._place) <= NEAR_PLACE]
        reach = gate + WALK * 1e-9 * (stamp_ns - self._stamp_ns)
        near = [a for a in new if np.linalg.norm(a.place - self._place) < reach]
        best = min(near, key=lambda a: -len(a.people), default=None)
        if best is None:
            return {}
        before, looks, last_ns = self._newcomer
        follows = stamp_ns - last_ns < OTHERS_NS and np.linalg.norm(best.place - before) < SAME
        looks = looks + 1 if follows else 1
        self._newcomer = best.place, looks, stamp_ns
        return best.people if looks >= LOOKS else {}

    def _without_others(self, appearances: list[Appearance]) -> list[Appearance]:
        """Those who are none of the others, who are followed."""
        pairs = sorted(
            (float(np.linalg.norm(a.place - other)), n, k)
            for n, a in enumerate(appearances) for k, other in enumerate(self._others)
        )  # fmt: skip
        taken, moved = set[int](), set[int]()
        for apart, n, k in pairs:
            if apart < SAME and n not in taken and k not in moved:
                taken.add(n)
                moved.add(k)
                self._others[k] = appearances[n].place
        return [a for n, a in enumerate(appearances) if n not in taken]


def appearances(weighing: Weighing, instant: Instant, claimed: list[People]) -> list[Appearance]:
    """Everybody who is seen by two views or more and whom nobody has claimed."""
    free = {
        (camera, p): (points, people.scores[p])
        for camera, people in instant.views.items() for p, points in enumerate(people.points)
        if np.isfinite(points).all(-1).sum() >= 3
        and not any(
            np.array_equal(points, own[camera][0], equal_nan=True) for own in claimed if camera in own
        )
    }  # fmt: skip
    rays = {key: _ray(weighing, key[0], points) for key, (points, _) in free.items()}
    found: list[Appearance] = []
    while True:
        best: People = {}
        used: list[tuple[int, int]] = []
        for first in rays:
            for second in rays:
                if first[0] < second[0]:
                    place = middle_of(weighing, {k[0]: free[k] for k in (first, second)}, None)
                    group = _meeting(rays, place) if place is not None else {}
                    if len(group) > max(len(best), 1):
                        best, used = {c: free[key] for c, key in group.items()}, list(group.values())
        if not used:
            return found
        middle = middle_of(weighing, best, None)
        assert middle is not None
        found.append(Appearance(middle, best))
        for key in used:
            del rays[key]


def _ray(weighing: Weighing, camera: int, points: Array) -> tuple[Array, Array]:
    """Centre (3,) of a camera and direction (3,) to the middle of a 2D person (K, 2)."""
    rotation = weighing.rotations[camera]
    middle = np.median(points[np.isfinite(points).all(-1)], axis=0)
    direction = rotation.T @ np.append(middle, 1.0)
    return -rotation.T @ weighing.translations[camera], direction / np.linalg.norm(direction)


def _meeting(
    rays: dict[tuple[int, int], tuple[Array, Array]], place: Array
) -> dict[int, tuple[int, int]]:
    """The nearest ray of every camera, by camera, of those that pass near a place before it."""
    found: dict[int, tuple[int, int]] = {}
    least: dict[int, float] = {}
    for key, (centre, direction) in rays.items():
        depth = float((place - centre) @ direction)
        apart = float(np.linalg.norm(place - centre - depth * direction)) if depth > 0.0 else math.inf
        if apart < NEAR_RAYS and apart < least.get(key[0], math.inf):
            found[key[0]], least[key[0]] = key, apart
    return found
