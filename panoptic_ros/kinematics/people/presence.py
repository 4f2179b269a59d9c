"""Presence of a subject: its 2D poses while it is in sight, and once it has returned.

`SubjectSearch` searches for a subject that was out of sight and may return elsewhere, among other people. A
person who is seen while the subject is not is another person, as long as that person can be followed. A new
person is the subject if several views agree and the position is within walking distance.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from panoptic_ros.domain.subjects import InstantViews
from panoptic_ros.kinematics.body.evidence import EvidenceBuilder
from panoptic_ros.kinematics.body.sight import ExpectedJoints, People
from panoptic_ros.kinematics.body.start import middle_of
from panoptic_ros.kinematics.body.tracker import SubjectTracker

Array = np.ndarray

NEAR_RAYS = 0.25  # m, maximum distance between rays to the middle of one person
SAME_PERSON = 0.6  # m, maximum movement of a person between observations
NEAR_PLACE = 0.4  # m from the expected position, within which a person may still be the subject
WALK, LOOKS = 3.0, 3  # m/s; observations of a new person before the subject is re-identified
OTHERS_NS = 300_000_000  # initial time of the search, in which all other people are recorded
SIGHTS_NS = 1_000_000_000  # maximum interval between two observations of a new person
# fraction of the usual number of views of the subject, below which the views that may show other people are
# excluded; gain of the running mean of the usual number
FEW, USUAL_SHARE = 0.5, 0.02
# m from the expected position of the subject, beyond which the views that may show other people are excluded,
# too
ODD = 0.2
ABSENT_S = 0.2  # time out of sight after which the search for the subject begins
MISSED = 3  # number of instants with images but without the subject, before the search for the subject begins
# gain of the running fraction of instants in which other people are in view; fraction above which one of them
# may be mistaken for the subject
COMPANY_SHARE, COMPANY = 0.1, 0.5


class PersonSighting(NamedTuple):
    """A person in several views: middle of the joints (3,) m, and 2D pose by camera."""

    place: Array
    people: People


class SubjectSearch:
    """Search for one subject that is out of sight.

    Args:
        place: (3,) m, expected position.
        stamp_ns: Timestamp, ns, of the last instant in which the subject was seen.
        alone: True if no other people were present. A person who is seen now is then the subject, of whom
            sight was lost.
    """

    def __init__(self, place: Array, stamp_ns: int, alone: bool = False):
        self._place, self._stamp_ns, self._alone = place, stamp_ns, alone
        self._others: list[Array] = []
        self._first_ns = -1  # timestamp of the first observation
        self._newcomer = (place, 0, -1)  # place, number of observations, timestamp of the last

    def look(self, appearances: list[PersonSighting], stamp_ns: int, gate: float) -> People:
        """Return the subject's 2D poses if it has returned, else an empty dict.

        Args:
            appearances: All people who are not assigned.
            gate: m, tolerance of the position for a subject that has not walked.
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

    def _without_others(self, appearances: list[PersonSighting]) -> list[PersonSighting]:
        """Return the people in `appearances` who are new, and update the positions of other known people."""
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


def appearances(
    weighing: EvidenceBuilder, instant: InstantViews, claimed: list[People]
) -> list[PersonSighting]:
    """Return all people whom two views or more see and whose 2D poses are not claimed."""
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
    left, found = np.ones(len(keys), bool), list[PersonSighting]()
    while left.sum() > 1:
        rows = np.flatnonzero(left)
        group = _largest(cameras[rows], centres[rows], ways[rows])
        if len(group) < 2:
            break
        left[rows[group]] = False
        best = {keys[row][0]: free[keys[row]] for row in rows[group].tolist()}
        middle = middle_of(weighing, best, None)
        assert middle is not None
        found.append(PersonSighting(middle, best))
    return found


def without_others(
    people: People, expected: ExpectedJoints, weighing: EvidenceBuilder, instant: InstantViews
) -> People:
    """Return a subject's 2D poses without 2D poses of people whom several views locate elsewhere.

    Args:
        expected: Expected joints of the subject.
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


def _ray(weighing: EvidenceBuilder, camera: int, points: Array) -> tuple[Array, Array]:
    """Return the centre (3,) m of a camera and the direction (3,) to the middle of a 2D pose (K, 2)."""
    rotation = weighing.rotations[camera]
    middle = np.median(points[np.isfinite(points).all(-1)], axis=0)
    direction = rotation.T @ np.append(middle, 1.0)
    return -rotation.T @ weighing.translations[camera], direction / np.linalg.norm(direction)


def _largest(cameras: Array, centres: Array, ways: Array) -> Array:
    """Return the rows of the rays that meet at the point where most rays meet, at most one per camera.

    Args:
        cameras: (N,), camera of each ray.
        centres, ways: (N, 3) m and (N, 3), origin and direction of each ray.
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


class SubjectPresence:
    """Sighting state of one subject: in sight, or searched for.

    Only instants with several views change the state, because a single view does not distinguish people.
    """

    def __init__(self) -> None:
        self.last_ns = 0  # ns, timestamp of the last instant in which the subject was seen; 0 = never
        self._missed = 0  # number of instants since `last_ns` with images but without the subject
        self._usual = 0.0  # usual number of views that see the subject
        # recent fraction of the subject's instants in which several views see other people, too
        self._company = 0.0
        self._absence: SubjectSearch | None = None

    @property
    def is_away(self) -> bool:
        """Return whether the subject is being searched for."""
        return self._absence is not None

    def own(
        self,
        people: People,
        expected: ExpectedJoints | None,
        weighing: EvidenceBuilder,
        instant: InstantViews,
    ) -> People:
        """Return the 2D poses in `people` that may belong to the subject.

        Args:
            people: 2D poses that are nearest to the expected body.
            expected: Expected joints of the subject; None before there is a pose.
        """
        if self._absence is not None:
            people = {}  # the nearest person may be another person: see `back`
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
        self,
        instant: InstantViews,
        weighing: EvidenceBuilder,
        claimed: list[People],
        gate: float,
        expected: ExpectedJoints | None,
    ) -> People:
        """Return the 2D poses of a subject who was away and has returned, else an empty dict.

        Args:
            claimed: 2D poses that belong to other people.
            gate: m, see `SubjectSearch.look`.
            expected: Expected joints of the subject. They locate the whole body of a person who is partly
                visible.
        """
        if self._absence is None or not instant.views:
            return {}
        there = appearances(weighing, instant, claimed)
        if expected is not None:
            there = [
                a._replace(place=a.place + expected.middle - expected.middle_seen(a.people)) for a in there
            ]
        return self._absence.look(there, instant.stamp_ns, gate)

    def saw(self, instant: InstantViews, is_seen: bool, expected: Array | None) -> None:
        """Record whether the subject was seen at an instant.

        The search for the subject begins after some time out of sight.

        Args:
            expected: (3,) m, expected middle of the subject's joints, predicted before the instant.
        """
        if is_seen:
            self.last_ns, self._missed, self._absence = instant.stamp_ns, 0, None
        elif len(instant.views) > 1 and self.last_ns:
            self._missed += 1
            missed = self._missed >= MISSED and instant.stamp_ns - self.last_ns > ABSENT_S * 1e9
            if missed and self._absence is None and expected is not None:
                self._absence = SubjectSearch(expected, self.last_ns, alone=self._company < COMPANY)

    def told(self, stamp_ns: int, views: int) -> None:
        """Record that a track holds the subject in `views` views."""
        self._usual += (views - self._usual) * USUAL_SHARE
        self.last_ns, self._missed, self._absence = stamp_ns, 0, None
        self._company = 1.0  # other people are unknown here


def middle_expected(tracker: SubjectTracker | None) -> Array | None:
    """Return the expected middle (3,) m of the joints of a body; None before there is a pose."""
    sites = None if tracker is None else tracker.expected_sites()
    return sites.middle if sites is not None and len(sites.places) else None
