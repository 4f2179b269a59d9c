"""Which 2D people of a recording are each subject's, instant by instant."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from panoptic_ros.domain import Rig
from panoptic_ros.domain.subjects import Instant, Subject
from panoptic_ros.errors import DataError
from panoptic_ros.kinematics.body.evidence import Weighing
from panoptic_ros.kinematics.body.tracker import SubjectTracker
from panoptic_ros.kinematics.config import KinematicsConfig
from panoptic_ros.kinematics.people.first_people import nearest_to_start
from panoptic_ros.kinematics.people.pairwise_sorting import PairwiseSorter
from panoptic_ros.kinematics.people.presence import Looked, Presence, middle_expected, people_of
from panoptic_ros.kinematics.people.returning import People

Array = np.ndarray
ALONE_S = 0.5  # for which a view waits for others that say the same of who stands where a subject starts


class RecordedPeople:
    """Where subjects start, where they are expected, and whether they are in sight.

    Attributes:
        presences: whether each subject is in sight.

    Args:
        weighing: of any of them. cameras: that have images.
    """

    def __init__(
        self,
        config: KinematicsConfig,
        rig: Rig | None,
        subjects: Sequence[Subject],
        weighing: Weighing,
        cameras: int,
    ):
        self._gate, self._subjects, self._weighing, self._cameras = config.gate, subjects, weighing, cameras
        self.presences = [Presence() for _ in subjects]
        self._sorter: PairwiseSorter | None = None
        if config.paper_sorting and rig is not None and cameras > 1:
            self._sorter = PairwiseSorter(rig, [subject.start for subject in subjects])
        self._first_ns: int | None = None

    def find(self, instant: Instant, trackers: Sequence[SubjectTracker]) -> tuple[list[People], list[bool]]:
        """2D people of each subject, and whether it is back that was out of sight.

        Raises:
            DataError: if nothing tells who of several people a subject is.
        """
        self._first_ns = instant.stamp_ns if self._first_ns is None else self._first_ns
        if self._sorter is None:
            looked = [Looked(tracker, presence) for tracker, presence in zip(trackers, self.presences)]
            people = people_of(looked, instant, self._weighing, self._gate)
        else:
            people = self._sorter.sort(instant, [middle_expected(tracker) for tracker in trackers])
        for k, (tracker, subject) in enumerate(zip(trackers, self._subjects)):
            is_sorted = self._sorter is not None and subject.start is not None
            if not tracker.started and not self.presences[k].is_away and not is_sorted:
                people[k] = self._first(subject, instant)
        back = [
            bool(own) and presence.is_away and tracker.started
            for own, presence, tracker in zip(people, self.presences, trackers)
        ]
        return people, back

    def _first(self, subject: Subject, instant: Instant) -> People:
        """Who stands where a subject starts; the only ones, if nothing says where."""
        if subject.start is None:
            crowd = max((len(people.points) for people in instant.views.values()), default=0)
            if crowd and (len(self._subjects) > 1 or crowd > 1):
                raise DataError(
                    f"subject {subject.id}: {crowd} people are seen and nothing says who it is; state "
                    "`start`, where the pelvis is at the first instant"
                )
        assert self._first_ns is not None
        alone = self._cameras < 2 or instant.stamp_ns > self._first_ns + 1e9 * ALONE_S
        return nearest_to_start(subject, instant, self._weighing, alone)
