"""Pass that gives the motion of all people by the method of Elhayek et al. 2012."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from panoptic_ros.continuous.elhayek.body import first_poses, skeleton_from, usable
from panoptic_ros.continuous.elhayek.config import ElhayekConfig
from panoptic_ros.continuous.elhayek.curve import person_curve
from panoptic_ros.continuous.elhayek.energy import PoseTerm
from panoptic_ros.continuous.elhayek.keypoints import WIDTHS, Keypoints, KeypointTerm
from panoptic_ros.continuous.elhayek.polynomials import FRAMES, segments_over
from panoptic_ros.continuous.elhayek.tracking import track
from panoptic_ros.continuous.motion_result import ContinuousMotion
from panoptic_ros.continuous.passes import ContinuousPass
from panoptic_ros.continuous.person import PersonCurve
from panoptic_ros.continuous.problem import LEAST_DEPTH
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

    The context holds the segment model as extra "segments".

    Raises:
        UsageError: as `ContinuousPass`, or if the skeleton of segments lacks a segment.
    """

    def __init__(self, config: ElhayekConfig, context: StageContext):
        self._config, self._skeleton = config, context.skeleton
        self._curves = ContinuousPass(config.continuous, context)
        self._arrays = RigArrays.of(context.rig)
        self._model: SegmentModel = context.extras["segments"]

    def run(self, recording: Recording, progress: Progress) -> ContinuousMotion:
        """Return the motion of all people.

        Raises:
            DataError: if there is no view, or a person whose shoulders and hips are never seen together.
        """
        motion = self._curves.run(recording, part_of(progress, 0.0, FOLLOWED))
        length = FRAMES * slowest_period(motion.people)
        share = part_of(progress, FOLLOWED, 1.0)
        people = []
        for k, person in enumerate(motion.people):
            own = part_of(share, k / len(motion.people), (k + 1) / len(motion.people))
            people.append(self._person(person, length, own))
        progress(1.0, "fitting segments")
        return replace(motion, people=tuple(people))

    def _person(self, person: PersonCurve, length: float, progress: Progress) -> PersonCurve:
        names = self._skeleton.joint_names
        instants = np.linspace(person.seen[0], person.seen[-1], BODY_INSTANTS)
        joints = person.at(instants)
        skeleton, misfits = skeleton_from(self._model, names, joints)
        segments = segments_over(float(person.seen[0]), float(person.seen[-1]), length)
        good = np.flatnonzero(usable(joints, names, skeleton))
        nearest = good[np.argmin(np.abs(instants[good] - segments[0].mean()))]
        pose = first_poses(skeleton, names, joints[nearest : nearest + 1])[0]
        sigmas = noise_of(person, self._arrays)
        keypoints = Keypoints.of(person.rays, person.times, sigmas, self._arrays, skeleton)

        def terms_of(first: float, last: float) -> Sequence[Sequence[PoseTerm]]:
            own = keypoints.between(first, last)
            return [[KeypointTerm(own, skeleton, width)] for width in WIDTHS] if len(own.times) else []

        motion, covariances = track(
            skeleton, segments, pose, terms_of, lambda done: progress(done, "fitting segments")
        )
        return person_curve(person, skeleton, motion, covariances, misfits)


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
