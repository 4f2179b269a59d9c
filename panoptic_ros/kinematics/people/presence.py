"""Which 2D people of an instant are a subject's, while it is in sight, and once it is back.

`Absence` is about somebody who was out of sight and comes back, maybe elsewhere, while others are there.
Whoever is seen while the subject is not is somebody else, and stays so as long as he can be followed. Who
appears besides, where several views agree and within what one can walk, is the subject.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from panoptic_ros.domain.subjects import Instant
from panoptic_ros.kinematics.body.evidence import Weighing
from panoptic_ros.kinematics.body.sight import People, Sites
from panoptic_ros.kinematics.body.start import middle_of
from panoptic_ros.kinematics.body.tracker import SubjectTracker

Array = np.ndarray

NEAR_RAYS = 0.25  # m, between rays to the middle of one person
SAME_PERSON = 0.6  # m, that somebody moves between looks
NEAR_PLACE = 0.4  # m, from where the subject is expected: may still be the subject
WALK, LOOKS = 3.0, 3  # m/s; looks in which a newcomer is seen before he counts
OTHERS_NS = 300_000_000  # of looking, in which all others are met
SIGHTS_NS = 1_000_000_000  # between two sights of a newcomer, at most
FEW, USUAL_SHARE = 0.5, 0.02  # of the views that usually see a subject: less, and others are told from it,
ODD = 0.2  # m, and where these see it elsewhere than it is expected
ABSENT_S = 0.2  # out of sight, after which it is looked for
MISSED = 3  # instants with images without it, before
COMPANY_SHARE, COMPANY = 0.1, 0.5  # of newer instants; of instants with others, who may be mistaken for it


class Appearance(NamedTuple):
    """Where (3,) m the middle of somebody is, and his 2D people by camera."""

    place: Array
    people: People


class Absence:
    """One subject out of sight.

    Args:
        place: (3,) m, where it is expected as it goes. stamp_ns: of the last instant in which it was seen.
        alone: nobody else was there, so whoever is seen now is the subject, of whom sight was lost.
    """

    def __init__(self, place: Array, stamp_ns: int, alone: bool = False):
        self._place, self._stamp_ns, self._alone = place, stamp_ns, alone
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
        if not self._alone and stamp_ns - self._first_ns < OTHERS_NS:
            self._others += [a.place for a in new if np.linalg.norm(a.place - self._place) > NEAR_PLACE]
            new = [a for a in new if np.linalg.norm(a.place - self._place) <= NEAR_PLACE]
        reach = gate + WALK * 1e-9 * (stamp_ns - self._stamp_ns)
        near = [a for a in new if np.linalg.norm(a.place - self._place) < reach]
        best = min(near, key=lambda a: -len(a.people), default=None)
        if best is None:
            return {}
        before, looks, last_ns = self._newcomer
        follows = stamp_ns - last_ns < SIGHTS_NS and np.linalg.norm(best.place - before) < SAME_PERSON
        looks = looks + 1 if follows else 1
        self._newcomer = best.place, looks, stamp_ns
        return best.people if looks >= LOOKS else {}

    def _without_others(self, appearances: list[Appearance]) -> list[Appearance]:
        """Those who are none of the others, who are followed."""
        pairs = sorted(
            (float(np.linalg.norm(a.place - other)), n, k)
            for n, a in enumerate(appearances)
            for k, other in enumerate(self._others)
        )
        taken, moved = set[int](), set[int]()
        for apart, n, k in pairs:
            if apart < SAME_PERSON and n not in taken and k not in moved:
                taken.add(n)
                moved.add(k)
                self._others[k] = appearances[n].place
        return [a for n, a in enumerate(appearances) if n not in taken]


def appearances(weighing: Weighing, instant: Instant, claimed: list[People]) -> list[Appearance]:
    """Everybody who is seen by two views or more and whom nobody has claimed."""
    free = {
        (camera, p): (points, people.scores[p])
        for camera, people in instant.views.items()
        for p, points in enumerate(people.points)
        if np.isfinite(points).all(-1).sum() >= 3
        and not any(
            np.array_equal(points, own[camera][0], equal_nan=True) for own in claimed if camera in own
        )
    }
    keys = list(free)
    rays = [_ray(weighing, camera, free[camera, p][0]) for camera, p in keys]
    centres, ways = np.array([r[0] for r in rays]), np.array([r[1] for r in rays])
    cameras = np.array([camera for camera, _ in keys])
    left, found = np.ones(len(keys), bool), list[Appearance]()
    while left.sum() > 1:
        rows = np.flatnonzero(left)
        group = _largest(cameras[rows], centres[rows], ways[rows])
        if len(group) < 2:
            break
        left[rows[group]] = False
        best = {keys[row][0]: free[keys[row]] for row in rows[group].tolist()}
        middle = middle_of(weighing, best, None)
        assert middle is not None
        found.append(Appearance(middle, best))
    return found


def without_others(people: People, expected: Sites, weighing: Weighing, instant: Instant) -> People:
    """A subject's 2D people without those of whom several views say that they are elsewhere.

    Args:
        expected: the subject's joints.
    """
    elsewhere = [
        other.people
        for other in appearances(weighing, instant, [])
        if np.linalg.norm(other.place - expected.middle_seen(other.people)) > NEAR_PLACE
    ]
    return {
        camera: own
        for camera, own in people.items()
        if not any(camera in o and np.array_equal(o[camera][0], own[0], equal_nan=True) for o in elsewhere)
    }


def _ray(weighing: Weighing, camera: int, points: Array) -> tuple[Array, Array]:
    """Centre (3,) of a camera and direction (3,) to the middle of a 2D person (K, 2)."""
    rotation = weighing.rotations[camera]
    middle = np.median(points[np.isfinite(points).all(-1)], axis=0)
    direction = rotation.T @ np.append(middle, 1.0)
    return -rotation.T @ weighing.translations[camera], direction / np.linalg.norm(direction)


def _largest(cameras: Array, centres: Array, ways: Array) -> Array:
    """Rows of the rays, one of each camera at most, that meet at the place where most meet.

    Args:
        cameras: (N,). centres, ways: (N, 3), of the rays.
    """
    first, second = np.nonzero(cameras[:, None] < cameras[None, :])
    between = centres[second] - centres[first]
    cosine = (ways[first] * ways[second]).sum(-1)
    along = (between * ways[first]).sum(-1), (between * ways[second]).sum(-1)
    scale = np.maximum(1.0 - cosine**2, 1e-6)
    depths = (along[0] - cosine * along[1]) / scale, (cosine * along[0] - along[1]) / scale
    ends = [centres[k] + depth[:, None] * ways[k] for k, depth in zip((first, second), depths)]
    good = (np.linalg.norm(ends[0] - ends[1], axis=-1) < NEAR_RAYS) & (depths[0] > 0.0) & (depths[1] > 0.0)
    places = 0.5 * (ends[0] + ends[1])[good]
    if not len(places):
        return np.zeros(0, int)
    to_place = places[:, None] - centres
    depth = (to_place * ways).sum(-1)
    apart = np.linalg.norm(to_place - depth[..., None] * ways, axis=-1)
    apart[depth <= 0.0] = math.inf
    seen = [apart[:, cameras == c].min(1) < NEAR_RAYS for c in np.unique(cameras)]
    support, miss = np.sum(seen, axis=0), np.minimum(apart, NEAR_RAYS).sum(1)
    best = int(np.lexsort((miss, -support))[0])
    group = [
        rows[np.argmin(apart[best, rows])]
        for c in np.unique(cameras)
        for rows in [np.flatnonzero(cameras == c)]
        if apart[best, rows].min() < NEAR_RAYS
    ]
    return np.array(group, int)


class Presence:
    """Whether one subject is in sight, by instants with several views: one alone does not tell who is who."""

    def __init__(self) -> None:
        self.last_ns = 0  # of the last instant in which it was seen, 0 = never
        self._missed = 0  # instants with images without it since then
        self._usual = 0.0  # views that see it
        self._company = 0.0  # share of the instants with it, of late, in which several views see others too
        self._absence: Absence | None = None

    @property
    def is_away(self) -> bool:
        """Whether it is looked for."""
        return self._absence is not None

    def own(self, people: People, expected: Sites | None, weighing: Weighing, instant: Instant) -> People:
        """Of the 2D people that are nearest to where it is expected those that may be its own.

        Args:
            expected: its joints; None before there is a pose.
        """
        if self._absence is not None:
            people = {}  # who is near may be somebody else: see `back`
        elif people and len(instant.views) > 1 and expected is not None:
            seen = middle_of(weighing, people, None)
            odd = seen is None or np.linalg.norm(seen - expected.middle_seen(people)) > ODD
            if odd or len(people) < FEW * self._usual:
                left = without_others(people, expected, weighing, instant)
                people = left if len(left) > 1 else {}
        if instant.views:
            self._usual += (len(people) - self._usual) * USUAL_SHARE
        if people:
            several = sum(len(view.points) > 1 for view in instant.views.values()) > 1
            self._company += (several - self._company) * COMPANY_SHARE
        return people

    def back(
        self, instant: Instant, weighing: Weighing, claimed: list[People], gate: float, expected: Sites | None
    ) -> People:
        """Its 2D people, if it is away and back.

        Args:
            claimed: 2D people that are others'. gate: m, see `Absence.look`. expected: its joints; of who is
                seen in part, they tell where the whole is.
        """
        if self._absence is None or not instant.views:
            return {}
        there = appearances(weighing, instant, claimed)
        if expected is not None:
            there = [
                a._replace(place=a.place + expected.middle - expected.middle_seen(a.people)) for a in there
            ]
        return self._absence.look(there, instant.stamp_ns, gate)

    def saw(self, instant: Instant, is_seen: bool, expected: Array | None) -> None:
        """An instant is over; whoever has been out of sight for a while is looked for from now on.

        Args:
            expected: as above, before the instant.
        """
        if is_seen:
            self.last_ns, self._missed, self._absence = instant.stamp_ns, 0, None
        elif len(instant.views) > 1 and self.last_ns:
            self._missed += 1
            missed = self._missed >= MISSED and instant.stamp_ns - self.last_ns > ABSENT_S * 1e9
            if missed and self._absence is None and expected is not None:
                self._absence = Absence(expected, self.last_ns, alone=self._company < COMPANY)

    def told(self, stamp_ns: int, views: int) -> None:
        """A track holds it in so many views."""
        self._usual += (views - self._usual) * USUAL_SHARE
        self.last_ns, self._missed, self._absence = stamp_ns, 0, None
        self._company = 1.0  # nothing tells here who else is there


def middle_expected(tracker: SubjectTracker | None) -> Array | None:
    """The middle (3,) m of the joints of a body where it is expected; None before there is a pose."""
    sites = None if tracker is None else tracker.expected_sites()
    return sites.middle if sites is not None and len(sites.places) else None
