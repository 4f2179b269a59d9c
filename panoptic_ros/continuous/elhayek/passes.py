"""Pass that gives the motion of all people by the method of Elhayek et al. 2012."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from panoptic_ros.continuous.config import ContinuousConfig
from panoptic_ros.continuous.designated import designated, with_subject_id
from panoptic_ros.continuous.elhayek.body import first_poses, misfits_of, skeleton_from, usable
from panoptic_ros.continuous.elhayek.body_blobs import TimedBlobs, body_blobs, coloured
from panoptic_ros.continuous.elhayek.curve import person_curve
from panoptic_ros.continuous.elhayek.image_term import ImageMeasurements
from panoptic_ros.continuous.elhayek.keypoints import KeypointMeasurements, Keypoints
from panoptic_ros.continuous.elhayek.polynomials import FRAMES, segments_over
from panoptic_ros.continuous.elhayek.quad_tree import image_blobs
from panoptic_ros.continuous.elhayek.score_maps import ScoreMapMeasurements, TimedMaps, timed_maps
from panoptic_ros.continuous.elhayek.skeleton import HingeSkeleton, skeleton_of
from panoptic_ros.continuous.elhayek.tracking import Measurements, track
from panoptic_ros.continuous.motion_result import ContinuousMotion
from panoptic_ros.continuous.passes import UNKNOWN_PERIOD_S, ContinuousPass
from panoptic_ros.continuous.person import PersonCurve
from panoptic_ros.domain.body_shape import BodyShape
from panoptic_ros.domain.rig_arrays import RigArrays
from panoptic_ros.domain.segments import SegmentModel
from panoptic_ros.domain.subjects import Subject
from panoptic_ros.errors import DataError
from panoptic_ros.stage import Progress, Recording, StageContext, part_of

Array = np.ndarray
Fitted = Literal["joints", "images", "maps"]
Measuring = Callable[[PersonCurve, HingeSkeleton, Array], Measurements]  # person, skeleton, first segment (s)
# Greatest degree of the polynomials; the paper says "low". Error of ankles above 8 m/s in a run: 31 mm with
# degree 5, 53 mm with degree 4.
DEGREE = 5
IMAGE_DEGREE = 3  # images say less: with degree 4, legs that pass change places
# Views of a segment per coefficient of a coordinate: twice as many equations as unknowns of a point. With
# degree 4 instead, 11 views per segment have errors of 12 mm, with this degree 7 mm.
VIEWS = 3.0
FOLLOWED = 0.2  # share of the run time until people are followed
BODY_INSTANTS = 400  # number of instants of the joint curves among which the skeleton is fitted
LONGEST_PERIOD_S = 1.0  # s, longest period of a camera that sets the length of segments


class ElhayekPass:
    """Pass (`stage.Pass`): people and known poses from the joint curves, then segments of polynomials.

    The context holds the segment model as extra "segments", and with images its shape as "body_shape".

    Args:
        subject: person whose skeleton is known. The others get the default skeleton in their own size.
        fitted: "joints" = 2D joints, "images" = the records "image" of the recording, "maps" = the score maps
            of its views. People, their skeletons and their pose in the first segment come from 2D joints in
            any case.

    Raises:
        UsageError: as `ContinuousPass`, or if the skeleton of segments lacks a segment.
    """

    def __init__(
        self,
        config: ContinuousConfig,
        context: StageContext,
        subject: Subject | None = None,
        fitted: Fitted = "joints",
    ):
        self._names, self._subject = context.skeleton.joint_names, subject
        self._curves = ContinuousPass(config, context)
        self._arrays = RigArrays.of(context.rig)
        self._model: SegmentModel = context.extras["segments"]
        self._fitted = fitted
        if fitted == "images":
            self._shape: BodyShape = context.extras["body_shape"]

    def run(self, recording: Recording, progress: Progress) -> ContinuousMotion:
        """Return the motion of all people.

        Raises:
            DataError: if there is no view, or a person whose shoulders and hips are never seen together.
            UsageError: if it is not clear who the subject is.
        """
        motion = self._curves.run(recording, part_of(progress, 0.0, FOLLOWED))
        length = FRAMES * slowest_period(motion.people)
        chosen = -1 if self._subject is None else designated(self._subject, motion.people)
        measuring = self._measuring(recording, motion)
        share, people = part_of(progress, FOLLOWED, 1.0), []
        for k, person in enumerate(motion.people):
            own = part_of(share, k / len(motion.people), (k + 1) / len(motion.people))
            subject = self._subject if person.id == chosen else None
            people.append(self._person(person, length, subject, measuring, own))
        progress(1.0, "fitting segments")
        if self._subject is not None:
            people = with_subject_id(people, chosen, self._subject.id)
        return replace(motion, people=tuple(people))

    def _measuring(self, recording: Recording, motion: ContinuousMotion) -> Measuring:
        """Return the function that gives the measurements of a person."""
        arrays = self._arrays
        if self._fitted == "joints":
            return lambda person, skeleton, _: KeypointMeasurements(Keypoints.of(person, arrays), skeleton)
        if self._fitted == "images":
            images = self._images(recording, motion)
            return lambda person, skeleton, first: self._coloured(person, skeleton, first, images)
        maps = self._maps(recording, motion)
        return lambda _, skeleton, __: ScoreMapMeasurements(maps, skeleton, arrays)

    def _images(self, recording: Recording, motion: ContinuousMotion) -> list[TimedBlobs]:
        """Return the blobs of all images, ordered by time."""
        found = []
        for frame in recording.records("image"):
            camera = self._arrays.index[frame.camera]
            time = _middle_time(motion, camera, frame.stamp_ns, frame.image.shape[0])
            found.append(TimedBlobs(time, camera, image_blobs(frame.image, self._arrays.cameras[camera])))
        return sorted(found, key=lambda image: (image.time, image.camera))

    def _maps(self, recording: Recording, motion: ContinuousMotion) -> list[TimedMaps]:
        """Return the score maps of all views, ordered by time."""
        found, joints = [], len(self._names)
        for view in (view for item in recording.records("detection_sets") for view in item.views):
            if view.maps is not None:
                camera = self._arrays.index[view.camera]
                time = _middle_time(motion, camera, view.stamp_ns, view.image_size[1])
                found.append(timed_maps(time, camera, view.maps, joints, self._arrays))
        return sorted(found, key=lambda maps: (maps.time, maps.camera))

    def _person(
        self,
        person: PersonCurve,
        length: float,
        subject: Subject | None,
        measuring: Measuring,
        progress: Progress,
    ) -> PersonCurve:
        names = self._names
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

        counts = np.diff(np.searchsorted(person.seen, segments), axis=1)
        most = IMAGE_DEGREE if self._fitted == "images" else DEGREE
        degree = int(np.clip(np.median(counts) // VIEWS - 1, 1, most))
        measured = measuring(person, skeleton, segments[0])
        motion, covariances = track(
            skeleton, segments, known, measured, degree, lambda done: progress(done, "fitting segments")
        )
        misfits = misfits_of(skeleton, names, person.at(good))
        return person_curve(person, skeleton, motion, covariances, misfits)

    def _coloured(
        self, person: PersonCurve, skeleton: HingeSkeleton, first: Array, images: Sequence[TimedBlobs]
    ) -> Measurements:
        """Return the images with the body of a person, coloured in the first segment (2,) s.

        Raises:
            DataError: if no images show the person there.
        """
        early = [image for image in images if first[0] <= image.time <= first[1]]
        joints = person.at(np.array([image.time for image in early]))
        shown = usable(joints, self._names)
        views = [image for image, good in zip(early, shown) if good]
        poses = first_poses(skeleton, self._names, joints[shown])
        body = coloured(body_blobs(skeleton, self._shape), skeleton, poses, views, self._arrays)
        if not len(body.radii):
            raise DataError(f"no images show person {person.id} where it is first seen")
        return ImageMeasurements(images, body, skeleton, self._arrays)


def _middle_time(motion: ContinuousMotion, camera: int, stamp_ns: int, rows: int) -> float:
    """Return the time (s) at which the middle of the image rows is exposed, from the timestamp of a view."""
    offsets, drifts, lines = motion.clocks.values
    stamp = 1e-9 * (stamp_ns - motion.reference_ns)
    return float(stamp + offsets[camera] + drifts[camera] * stamp + 0.5 * rows * lines[camera])


def slowest_period(people: Sequence[PersonCurve]) -> float:
    """Return the time (s) between two frames of the slowest camera that shows a person."""
    periods = [0.0]
    for rays in (person.rays for person in people):
        stamps = [np.unique(rays.stamps[rays.cameras == camera]) for camera in np.unique(rays.cameras)]
        periods += [float(np.median(np.diff(own))) for own in stamps if len(own) > 1]
    return max(period for period in periods if period <= LONGEST_PERIOD_S) or UNKNOWN_PERIOD_S
