"""Which 2D people of an instant are a subject's, while it is in sight, and once it is back."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from panoptic_ros.domain.subjects import Instant
from panoptic_ros.kinematics.body.evidence import Weighing
from panoptic_ros.kinematics.body.sight import Sites
from panoptic_ros.kinematics.body.start import middle_of
from panoptic_ros.kinematics.body.tracker import SubjectTracker
from panoptic_ros.kinematics.people.nearest_people import assign_people
from panoptic_ros.kinematics.people.returning import Absence, People, appearances, without_others

Array = np.ndarray
FEW, USUAL_SHARE = 0.5, 0.02  # of the views that usually see a subject: less, and others are told from it,
ODD = 0.2  # m, and where these see it elsewhere than it is expected
ABSENT_S = 0.2  # out of sight, after which it is looked for
MISSED = 3  # instants with images without it, before
COMPANY_SHARE, COMPANY = 0.1, 0.5  # of newer instants; of instants with others, who may be mistaken for it


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

    def saw(self, instant: Instant, is_seen: bool, expected: Array | None) -> int:
        """An instant is over: for how long the subject has been out of sight, ns.

        Args:
            expected: as above, before the instant.
        """
        if is_seen:
            self.last_ns, self._missed, self._absence = instant.stamp_ns, 0, None
        if is_seen or len(instant.views) < 2 or not self.last_ns:
            return 0
        self._missed += 1
        unseen = instant.stamp_ns - self.last_ns if self._missed >= MISSED else 0
        if unseen > ABSENT_S * 1e9 and self._absence is None and expected is not None:
            self._absence = Absence(expected, self.last_ns, alone=self._company < COMPANY)
        return unseen

    def told(self, stamp_ns: int, views: int) -> None:
        """A track holds it in so many views."""
        self._usual += (views - self._usual) * USUAL_SHARE
        self.last_ns, self._missed, self._absence = stamp_ns, 0, None
        self._company = 1.0  # nothing tells here who else is there


class Looked(NamedTuple):
    """A subject that is looked for in the views of an instant."""

    tracker: SubjectTracker | None  # None: it has not begun
    presence: Presence


def people_of(subjects: Sequence[Looked], instant: Instant, weighing: Weighing, gate: float) -> list[People]:
    """2D people of the views for each subject: nearest first, of several views that agree; nobody twice."""
    trackers = [tracker for tracker, _ in subjects]
    people = assign_people(trackers, instant, weighing.rotations, weighing.translations, gate)
    for k, (tracker, presence) in enumerate(subjects):
        expected = None if tracker is None else tracker.expected_sites()
        people[k] = presence.own(people[k], expected, weighing, instant)
        people[k] = people[k] or presence.back(instant, weighing, people, gate, expected)
    return people


def middle_expected(tracker: SubjectTracker | None) -> Array | None:
    """The middle (3,) m of the joints of a body where it is expected; None before there is a pose."""
    sites = None if tracker is None else tracker.expected_sites()
    return sites.middle if sites is not None and len(sites.places) else None
