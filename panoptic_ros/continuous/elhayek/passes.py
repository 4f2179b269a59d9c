"""Pass that gives the motion of all people by the method of Elhayek et al. 2012."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from panoptic_ros.continuous.elhayek.body import first_poses, skeleton_from, usable
from panoptic_ros.continuous.elhayek.body_blobs import TimedBlobs, body_blobs, coloured
from panoptic_ros.continuous.elhayek.config import ElhayekConfig
from panoptic_ros.continuous.elhayek.curve import person_curve
from panoptic_ros.continuous.elhayek.image_term import ImageMeasurements
from panoptic_ros.continuous.elhayek.keypoints import KeypointMeasurements, Keypoints
from panoptic_ros.continuous.elhayek.polynomials import DEGREE, FRAMES, IMAGE_DEGREE, segments_over
from panoptic_ros.continuous.elhayek.quad_tree import image_blobs
from panoptic_ros.continuous.elhayek.skeleton import Skeleton
from panoptic_ros.continuous.elhayek.tracking import Measurements, track
from panoptic_ros.continuous.motion_result import ContinuousMotion
from panoptic_ros.continuous.passes import ContinuousPass
from panoptic_ros.continuous.person import PersonCurve
from panoptic_ros.continuous.problem import LEAST_DEPTH
from panoptic_ros.domain.body_shape import BodyShape
from panoptic_ros.domain.rig_arrays import RigArrays
from panoptic_ros.domain.segments import SegmentModel
from panoptic_ros.stage import Progress, Recording, StageContext, part_of

Array = np.ndarray
FOLLOWED = 0.2  # share of the run time until people are followed
BODY_INSTANTS = 400  # number of instants of the joint curves among which the skeleton is fitted
RAYLEIGH_MEDIAN = 1.17741  # median length of a 2D residual with standard deviation 1 per axis
LEAST_NOISE = 1e-4  # on the normalised image plane: 0.15 px at a focal length of 1500 px
UNKNOWN_PERIOD_S = 0.1  # s between frames where no camera has two
MOST_PERIOD_S = 1.0  # s, longest period of a camera that sets the length of segments


class ElhayekPass:
    """Pass (`stage.Pass`): people and first poses from the joint curves, then segments of polynomials.

    The context holds the segment model and its shape as extras "segments" and "body_shape". Images are records
    "image" of the recording.

    Raises:
        UsageError: as `ContinuousPass`, or if the skeleton of segments lacks a segment.
    """

    def __init__(self, config: ElhayekConfig, context: StageContext):
        self._config, self._skeleton = config, context.skeleton
        self._curves = ContinuousPass(config.continuous, context)
        self._arrays = RigArrays.of(context.rig)
        self._model: SegmentModel = context.extras["segments"]
        self._shape: BodyShape = context.extras["body_shape"]

    def run(self, recording: Recording, progress: Progress) -> ContinuousMotion:
        """Return the motion of all people.

        Raises:
            DataError: if there is no view, or a person whose shoulders and hips are never seen together.
        """
        motion = self._curves.run(recording, part_of(progress, 0.0, FOLLOWED))
        images = self._images(recording, motion) if self._config.images else []
        length = FRAMES * slowest_period(motion.people)
        share = part_of(progress, FOLLOWED, 1.0)
        people = []
        for k, person in enumerate(motion.people):
            own = part_of(share, k / len(motion.people), (k + 1) / len(motion.people))
            people.append(self._person(person, length, images, own))
        progress(1.0, "fitting segments")
        return replace(motion, people=tuple(people))

    def _images(self, recording: Recording, motion: ContinuousMotion) -> list[TimedBlobs]:
        """Return the blobs of all images, ordered by time."""
        offsets, drifts, lines = motion.clocks.values
        found = []
        for frame in recording.records("image"):
            camera = self._arrays.index[frame.camera]
            stamp = 1e-9 * (frame.stamp_ns - motion.reference_ns)
            middle = 0.5 * frame.image.shape[0]
            time = stamp + offsets[camera] + drifts[camera] * stamp + lines[camera] * middle
            found.append(TimedBlobs(time, camera, image_blobs(frame.image, self._arrays.cameras[camera])))
        return sorted(found, key=lambda image: (image.time, image.camera))

    def _person(
        self, person: PersonCurve, length: float, images: Sequence[TimedBlobs], progress: Progress
    ) -> PersonCurve:
        names = self._skeleton.joint_names
        instants = np.linspace(person.seen[0], person.seen[-1], BODY_INSTANTS)
        joints = person.at(instants)
        skeleton, misfits = skeleton_from(self._model, names, joints)
        segments = segments_over(float(person.seen[0]), float(person.seen[-1]), length)
        good = np.flatnonzero(usable(joints, names, skeleton))
        nearest = good[np.argmin(np.abs(instants[good] - segments[0].mean()))]
        pose = first_poses(skeleton, names, joints[nearest : nearest + 1])[0]
        measured: list[Measurements] = []
        if self._config.keypoints:
            sigmas = noise_of(person, self._arrays)
            keypoints = Keypoints.of(person.rays, person.times, sigmas, self._arrays, skeleton)
            measured.append(KeypointMeasurements(keypoints, skeleton))
        if images:
            measured.append(self._image_measurements(person, segments[0], images, skeleton))
        degree = DEGREE if self._config.keypoints else IMAGE_DEGREE
        motion, covariances = track(
            skeleton, segments, pose, measured, degree, lambda done: progress(done, "fitting segments")
        )
        return person_curve(person, skeleton, motion, covariances, misfits)

    def _image_measurements(
        self, person: PersonCurve, first: Array, images: Sequence[TimedBlobs], skeleton: Skeleton
    ) -> ImageMeasurements:
        """Return the images as measurements of a person whose body is coloured from the first segment."""
        names = self._skeleton.joint_names
        early = [image for image in images if first[0] <= image.time <= first[1]]
        joints = person.at(np.array([image.time for image in early]))
        shown = usable(joints, names, skeleton)
        poses = first_poses(skeleton, names, joints[shown])
        views = [image for image, good in zip(early, shown) if good]
        body = coloured(body_blobs(skeleton, self._shape), skeleton, poses, views, self._arrays)
        return ImageMeasurements(images, body, skeleton, self._arrays)


def slowest_period(people: Sequence[PersonCurve]) -> float:
    """Return the time (s) between two frames of the slowest camera that shows a person."""
    periods = [UNKNOWN_PERIOD_S]
    for person in people:
        for camera in np.unique(person.rays.cameras):
            stamps = np.unique(person.rays.stamps[person.rays.cameras == camera])
            if len(stamps) > 1:
                periods.append(float(np.median(np.diff(stamps))))
    return max((period for period in periods[1:] if period <= MOST_PERIOD_S), default=periods[0])


def noise_of(person: PersonCurve, arrays: RigArrays) -> Array:
    """Return the standard deviations (N,) of the 2D joints on the normalised plane, one value per camera.

    They are medians of the residuals about the joint curves.
    """
    rays = person.rays
    points = person.at(person.times)[np.arange(len(person.times)), rays.joints]
    depths = np.einsum("ni,ni->n", arrays.rotations[rays.cameras, 2], points)
    depths = np.maximum(depths + arrays.translations[rays.cameras, 2], LEAST_DEPTH)
    misses = np.einsum("nij,nj->ni", rays.rows, points) - rays.rights
    lengths = np.linalg.norm(misses, axis=1) / depths
    found = np.empty(len(lengths))
    for camera in np.unique(rays.cameras):
        own = rays.cameras == camera
        found[own] = max(float(np.nanmedian(lengths[own])) / RAYLEIGH_MEDIAN, LEAST_NOISE)
    return found
