"""Whose the 2D people of an instant are: of whom a track holds them, or who is expected where they are."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from panoptic_ros.domain import Rig, TrackedPoseSet
from panoptic_ros.domain.rig_arrays import camera_records
from panoptic_ros.domain.subjects import Instant, ViewPeople
from panoptic_ros.errors import DataError
from panoptic_ros.geometry.lens_kernels import undistort_points
from panoptic_ros.kinematics.body.sight import People
from panoptic_ros.kinematics.people.nearest_people import assign_people, nearest_to_start
from panoptic_ros.kinematics.people.person import Person
from panoptic_ros.kinematics.people.presence import middle_expected
from panoptic_ros.kinematics.people.seen_people import SeenPoints

Array = np.ndarray
Rows = set[tuple[int, int]]  # cameras and rows of 2D people


class SeenView(NamedTuple):
    """2D people of a camera that wait for those who are tracked: camera, stamp ns, frame number, points (P,
    J, 2) px, scores (P, J)."""

    camera: int
    stamp_ns: int
    frame: int
    points: Array
    scores: Array


class SeenSet(NamedTuple):
    """Views of an instant, and the index of the detection set."""

    number: int
    views: tuple[SeenView, ...]


class Allotment:
    """Gives 2D people to those whose they are.

    Args:
        gate: m, from where somebody is expected.
    """

    def __init__(self, rig: Rig, gate: float):
        self._lenses, self._gate = camera_records(rig.cameras), gate
        self._cameras = {name: k for k, name in enumerate(rig.names)}
        self._planes(SeenView(0, 0, 0, np.zeros((0, 1, 2)), np.zeros((0, 1))), [])

    @property
    def cameras(self) -> tuple[str, ...]:
        """Their names."""
        return tuple(self._cameras)

    def camera(self, name: str) -> int:
        """The index of a camera.

        Raises:
            DataError: if the rig has none of this name.
        """
        if name not in self._cameras:
            raise DataError(f"a view of camera {name!r}; the rig has {', '.join(self._cameras)}")
        return self._cameras[name]

    def by_tracks(
        self, people: Mapping[int, Person], views: Sequence[SeenView], item: TrackedPoseSet
    ) -> Rows:
        """Give people the 2D people that their tracks hold; all that any track holds."""
        sources, taken = item.sources, Rows()
        if sources is None:
            return taken
        columns = {
            (self._cameras.get(name), int(frame)): v
            for v, (name, frame) in enumerate(zip(sources.cameras, sources.frames))
        }
        own: list[tuple[Person, int, SeenView, int]] = []
        for view in views:
            v = columns.get((view.camera, view.frame))
            if v is None:
                continue
            for number, row in zip(item.ids.tolist(), sources.persons[:, v].tolist()):
                if not 0 <= row < len(view.points):
                    continue
                taken.add((view.camera, row))
                if number in people:
                    own.append((people[number], number, view, row))
        if own:
            points = np.array([view.points[row] for _, _, view, row in own])
            scores = np.array([view.scores[row] for _, _, view, row in own])
            plane = self._plane(points, scores, np.array([view.camera for _, _, view, _ in own], np.int64))
            for k, (person, _, view, _) in enumerate(own):
                seen = SeenPoints(view.stamp_ns, plane.points[k], plane.scores[k])
                person.see(seen, view.camera, of_track=True)
        for number, count in Counter(number for _, number, _, _ in own).items():
            people[number].follow(item.stamp_ns, count)
        return taken

    def by_places(
        self,
        people: Mapping[int, Person],
        views: Sequence[SeenView],
        taken: Rows,
        tracked: set[int],
        tracks_begin: bool,
    ) -> None:
        """Give people without a track the 2D people that are where they are expected, or with which they
        come back.

        Args:
            taken: 2D people that tracks hold. tracked: ids of who is tracked.
            tracks_begin: whether only tracks tell where somebody is at first.
        """
        lost = [
            person
            for number, person in people.items()
            if number not in tracked and not (tracks_begin and person.is_new)
        ]
        if not views or not lost:
            return
        rows = {v.camera: [k for k in range(len(v.points)) if (v.camera, k) not in taken] for v in views}
        stamps = {v.camera: v.stamp_ns for v in views}
        instant = Instant(max(stamps.values()), {v.camera: self._planes(v, rows[v.camera]) for v in views})

        def first(person: Person, instant: Instant) -> People:
            alone = person.subject.start is not None or len(people) == 1
            return nearest_to_start(person.subject, instant, person.weighing) if alone else {}

        give_people(lost, find_people(lost, instant, self._gate, first), instant, stamps)

    def _planes(self, view: SeenView, rows: list[int]) -> ViewPeople:
        """Some 2D people of a view on the plane at distance 1."""
        return self._plane(view.points[rows], view.scores[rows], np.full(len(rows), view.camera, np.int64))

    def _plane(self, points: Array, scores: Array, cameras: Array) -> ViewPeople:
        """2D people (R, K, 2) px and scores (R, K) of cameras (R,) on the plane at distance 1."""
        usable = (scores > 0.0) & np.isfinite(points).all(-1)
        plane, _, good = undistort_points(np.ascontiguousarray(points), usable, cameras, self._lenses)
        plane[~good] = np.nan
        return ViewPeople(plane, np.where(good, scores, 0.0))


def find_people(
    people: Sequence[Person],
    instant: Instant,
    gate: float,
    first: Callable[[Person, Instant], People],
) -> list[People]:
    """2D people of each person: nearest to where it is expected, of several views that agree, or those with
    which it comes back; nobody twice.

    Args:
        gate: m. first: tells those of somebody of whom nothing tells where he is.
    """
    weighing, trackers = people[0].weighing, [person.tracker for person in people]
    found = assign_people(trackers, instant, weighing.rotations, weighing.translations, gate)
    for k, person in enumerate(people):
        expected = None if person.tracker is None else person.tracker.expected_sites()
        found[k] = person.presence.own(found[k], expected, weighing, instant)
        found[k] = found[k] or person.presence.back(instant, weighing, found, gate, expected)
    return [first(person, instant) if person.is_new else own for person, own in zip(people, found)]


def give_people(
    people: Sequence[Person], found: Sequence[People], instant: Instant, stamps: Mapping[int, int]
) -> None:
    """Give each person the 2D people that were found.

    Args:
        stamps: ns, of the images of the instant by camera.
    """
    for person, own in zip(people, found):
        person.look(instant, bool(own), middle_expected(person.tracker))
        for camera, (points, scores) in own.items():
            person.see(SeenPoints(stamps[camera], points, scores), camera, of_track=False)
