"""Assignment of the 2D poses of an instant to people: by their tracks, or by their expected positions."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from panoptic_ros.domain import Rig, TrackedPoseSet
from panoptic_ros.domain.rig_arrays import camera_records
from panoptic_ros.domain.subjects import InstantViews, ViewPeople
from panoptic_ros.errors import DataError
from panoptic_ros.geometry.lens_kernels import undistort_points
from panoptic_ros.kinematics.body.sight import People
from panoptic_ros.kinematics.people.nearest_people import assign_people, nearest_to_start
from panoptic_ros.kinematics.people.person import PersonState
from panoptic_ros.kinematics.people.presence import middle_expected
from panoptic_ros.kinematics.people.seen_people import ViewJoints

Array = np.ndarray
Rows = set[tuple[int, int]]  # camera and row of each 2D pose


class ViewObservations(NamedTuple):
    """2D poses of one camera that wait for the tracking result.

    Attributes:
        camera, stamp_ns, frame: Index, exposure of the middle row in ns, and frame number.
        points, scores: (P, J, 2) px and (P, J).
    """

    camera: int
    stamp_ns: int
    frame: int
    points: Array
    scores: Array


class InstantObservations(NamedTuple):
    """Views of an instant, and the index of their detection set."""

    number: int
    views: tuple[ViewObservations, ...]


class PoseAssignment:
    """Assignment of 2D poses to people.

    Args:
        gate: m, maximum distance from the expected body.
    """

    def __init__(self, rig: Rig, gate: float):
        self._lenses, self._gate = camera_records(rig.cameras), gate
        self._cameras = {name: k for k, name in enumerate(rig.names)}
        self._planes(ViewObservations(0, 0, 0, np.zeros((0, 1, 2)), np.zeros((0, 1))), [])

    @property
    def cameras(self) -> tuple[str, ...]:
        """Return the names of the cameras."""
        return tuple(self._cameras)

    def camera(self, name: str) -> int:
        """Return the index of a camera.

        Raises:
            DataError: If the rig has no camera of this name.
        """
        if name not in self._cameras:
            raise DataError(f"a view of camera {name!r}; the rig has {', '.join(self._cameras)}")
        return self._cameras[name]

    def by_tracks(
        self, people: Mapping[int, PersonState], views: Sequence[ViewObservations], item: TrackedPoseSet
    ) -> Rows:
        """Give people the 2D poses that their tracks hold, and return the 2D poses of all tracks."""
        sources, taken = item.sources, Rows()
        if sources is None:
            return taken
        columns = {
            (self._cameras.get(name), int(frame)): v
            for v, (name, frame) in enumerate(zip(sources.cameras, sources.frames))
        }
        own: list[tuple[PersonState, int, ViewObservations, int]] = []
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
                seen = ViewJoints(view.stamp_ns, plane.points[k], plane.scores[k])
                person.see(seen, view.camera, of_track=True)
        for number, count in Counter(number for _, number, _, _ in own).items():
            people[number].follow(item.stamp_ns, count)
        return taken

    def by_places(
        self,
        people: Mapping[int, PersonState],
        views: Sequence[ViewObservations],
        taken: Rows,
        tracked: set[int],
        tracks_begin: bool,
    ) -> None:
        """Give people without a track the 2D poses at their expected positions, or 2D poses after a return.

        Args:
            taken: 2D poses that tracks hold.
            tracked: Ids of the tracked people.
            tracks_begin: True if only tracks determine where a person is at first.
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
        instant = InstantViews(
            max(stamps.values()), {v.camera: self._planes(v, rows[v.camera]) for v in views}
        )

        def first(person: PersonState, instant: InstantViews) -> People:
            alone = person.subject.start is not None or len(people) == 1
            return nearest_to_start(person.subject, instant, person.weighing) if alone else {}

        give_people(lost, find_people(lost, instant, self._gate, first), instant, stamps)

    def _planes(self, view: ViewObservations, rows: list[int]) -> ViewPeople:
        """Return some 2D poses of a view on the normalised image plane."""
        return self._plane(view.points[rows], view.scores[rows], np.full(len(rows), view.camera, np.int64))

    def _plane(self, points: Array, scores: Array, cameras: Array) -> ViewPeople:
        """Return 2D poses on the normalised image plane.

        Args:
            points, scores: (R, K, 2) px and (R, K).
            cameras: (R,), camera of each 2D pose.
        """
        usable = (scores > 0.0) & np.isfinite(points).all(-1)
        plane, _, good = undistort_points(np.ascontiguousarray(points), usable, cameras, self._lenses)
        plane[~good] = np.nan
        return ViewPeople(plane, np.where(good, scores, 0.0))


def find_people(
    people: Sequence[PersonState],
    instant: InstantViews,
    gate: float,
    first: Callable[[PersonState, InstantViews], People],
) -> list[People]:
    """Return the 2D poses of each person. No 2D pose is given to two people.

    They are the nearest to the expected body, except those that several views place elsewhere (see
    `SubjectPresence.own`). For a person who returns after an absence, they come from `SubjectPresence.back`.

    Args:
        gate: m, maximum distance from the expected body.
        first: Function that returns the 2D poses of a person whose position is unknown.
    """
    weighing, trackers = people[0].weighing, [person.tracker for person in people]
    found = assign_people(trackers, instant, weighing.rotations, weighing.translations, gate)
    for k, person in enumerate(people):
        expected = None if person.tracker is None else person.tracker.expected_sites()
        found[k] = person.presence.own(found[k], expected, weighing, instant)
        found[k] = found[k] or person.presence.back(instant, weighing, found, gate, expected)
    return [first(person, instant) if person.is_new else own for person, own in zip(people, found)]


def give_people(
    people: Sequence[PersonState], found: Sequence[People], instant: InstantViews, stamps: Mapping[int, int]
) -> None:
    """Give each person the 2D poses that were found.

    Args:
        stamps: Timestamps, ns, of the images of the instant, by camera.
    """
    for person, own in zip(people, found):
        person.look(instant, bool(own), middle_expected(person.tracker))
        for camera, (points, scores) in own.items():
            person.see(ViewJoints(stamps[camera], points, scores), camera, of_track=False)
