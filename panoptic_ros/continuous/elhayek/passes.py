"""Pass that gives the motion of all people by the method of Elhayek et al. 2012."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from panoptic_ros.continuous.config import ContinuousConfig
from panoptic_ros.continuous.elhayek.body import first_poses, misfits_of, skeleton_from, usable
from panoptic_ros.continuous.elhayek.curve import person_curve
from panoptic_ros.continuous.elhayek.keypoints import KeypointMeasurements, Keypoints
from panoptic_ros.continuous.elhayek.polynomials import FRAMES, segments_over
from panoptic_ros.continuous.elhayek.skeleton import skeleton_of
from panoptic_ros.continuous.elhayek.tracking import track
from panoptic_ros.continuous.motion_result import ContinuousMotion
from panoptic_ros.continuous.passes import UNKNOWN_PERIOD_S, ContinuousPass
from panoptic_ros.continuous.person import PersonCurve
from panoptic_ros.domain.rig_arrays import RigArrays
from panoptic_ros.domain.segments import SegmentModel
from panoptic_ros.domain.subjects import Subject
from panoptic_ros.errors import DataError, UsageError
from panoptic_ros.stage import Progress, Recording, StageContext, part_of

Array = np.ndarray
# Degree of the polynomials; the paper says "low". Error of ankles above 8 m/s in a run: 31 mm with degree 5,
# 53 mm with degree 4.
DEGREE = 5
FOLLOWED = 0.2  # share of the run time until people are followed
BODY_INSTANTS = 400  # number of instants of the joint curves among which the skeleton is fitted
LONGEST_PERIOD_S = 1.0  # s, longest period of a camera that sets the length of segments


class ElhayekPass:
    """Pass (`stage.Pass`): people and known poses from the joint curves, then segments of polynomials.

    The context holds the segment model as extra "segments".

    Args:
        subject: person whose skeleton is known. The others get the default skeleton in their own size.

    Raises:
        UsageError: as `ContinuousPass`, or if the skeleton of segments lacks a segment.
    """

    def __init__(self, config: ContinuousConfig, context: StageContext, subject: Subject | None = None):
        self._names, self._subject = context.skeleton.joint_names, subject
        self._curves = ContinuousPass(config, context)
        self._arrays = RigArrays.of(context.rig)
        self._model: SegmentModel = context.extras["segments"]

    def run(self, recording: Recording, progress: Progress) -> ContinuousMotion:
        """Return the motion of all people.

        Raises:
            DataError: if there is no view, or a person whose shoulders and hips are never seen together.
            UsageError: if it is not clear who the subject is.
        """
        motion = self._curves.run(recording, part_of(progress, 0.0, FOLLOWED))
        length, designated = FRAMES * slowest_period(motion.people), self._designated(motion.people)
        share, people = part_of(progress, FOLLOWED, 1.0), []
        for k, person in enumerate(motion.people):
            own = part_of(share, k / len(motion.people), (k + 1) / len(motion.people))
            subject = self._subject if k == designated else None
            people.append(self._person(person, length, subject, own))
        progress(1.0, "fitting segments")
        return replace(motion, people=tuple(people))

    def _designated(self, people: Sequence[PersonCurve]) -> int:
        """Return the index of the subject: the only person, or the nearest one to its start; -1 = none."""
        if self._subject is None or not people:
            return -1
        if self._subject.start is None:
            if len(people) > 1:
                raise UsageError(f"{len(people)} people are there; state the subject's start in its file")
            return 0
        places = [np.nanmedian(person.at(person.seen[:1])[0], axis=0) for person in people]
        return int(np.argmin(np.linalg.norm(np.array(places) - self._subject.start, axis=1)))

    def _person(
        self, person: PersonCurve, length: float, subject: Subject | None, progress: Progress
    ) -> PersonCurve:
        names, arrays = self._names, self._arrays
        segments = segments_over(float(person.seen[0]), float(person.seen[-1]), length)
        instants = np.linspace(person.seen[0], person.seen[-1], BODY_INSTANTS)
        good = instants[usable(person.at(instants), names)]
        if not len(good):
            raise DataError(f"no view shows shoulders and hips of person {person.id}; the preset needs them")
        skeleton = (
            skeleton_of(subject.body, names)
            if subject
            else skeleton_from(self._model, names, person.at(good))
        )

        def known(time: float) -> Array:
            """Return the pose (D,) of the joint curves at the usable instant nearest to a time (s)."""
            nearest = good[np.argmin(np.abs(good - time))]
            pose: Array = first_poses(skeleton, names, person.at(np.array([nearest])))[0]
            return pose

        measured = KeypointMeasurements(Keypoints.of(person, arrays), skeleton)
        motion, covariances = track(
            skeleton, segments, known, measured, DEGREE, lambda done: progress(done, "fitting segments")
        )
        misfits = misfits_of(skeleton, names, person.at(good))
        return person_curve(person, skeleton, motion, covariances, misfits)


def slowest_period(people: Sequence[PersonCurve]) -> float:
    """Return the time (s) between two frames of the slowest camera that shows a person."""
    periods = [0.0]
    for rays in (person.rays for person in people):
        stamps = [np.unique(rays.stamps[rays.cameras == camera]) for camera in np.unique(rays.cameras)]
        periods += [float(np.median(np.diff(own))) for own in stamps if len(own) > 1]
    return max(period for period in periods if period <= LONGEST_PERIOD_S) or UNKNOWN_PERIOD_S
