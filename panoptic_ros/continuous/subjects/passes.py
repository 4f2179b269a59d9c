"""Pass that gives a designated person curves of degrees of freedom, and all others curves of joints."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from panoptic_ros.continuous.config import ContinuousConfig
from panoptic_ros.continuous.designated import designated, with_subject_id
from panoptic_ros.continuous.elhayek.body import skeleton_from
from panoptic_ros.continuous.elhayek.skeleton import skeleton_of
from panoptic_ros.continuous.motion_result import ContinuousMotion
from panoptic_ros.continuous.passes import ContinuousPass
from panoptic_ros.continuous.person import PersonCurve
from panoptic_ros.continuous.subjects.fit import fit_freedoms, with_freedoms
from panoptic_ros.continuous.subjects.start import certain_joints, usable_instants
from panoptic_ros.domain.rig_arrays import RigArrays
from panoptic_ros.domain.segments import SegmentModel
from panoptic_ros.domain.subjects import Subject
from panoptic_ros.stage import Notice, Progress, Recording, StageContext, part_of

Array = np.ndarray
WIDEST_MISFIT = 0.03  # m, root mean square of what bones miss; fitted ones miss 5 mm
FOLLOWED = 0.3  # share of the run time until people are followed


class SubjectPass:
    """Pass (`stage.Pass`): everything from the joint curves, then a second solve for the subject.

    The context holds the segment model as extra "segments".

    Args:
        subject: designated person. Bones that its file omits are fitted to its joint curves.

    Raises:
        UsageError: as `ContinuousPass`, or if the skeleton of segments lacks a segment.
    """

    def __init__(self, config: ContinuousConfig, context: StageContext, subject: Subject):
        self._names, self._subject = context.skeleton.joint_names, subject
        self._derived = context.skeleton.derived
        self._curves = ContinuousPass(config, context)
        self._arrays = RigArrays.of(context.rig)
        self._model: SegmentModel = context.extras["segments"]

    def run(self, recording: Recording, progress: Progress) -> ContinuousMotion:
        """Return the motion of all people.

        Raises:
            DataError: if there is no view, or none that shows shoulders and hips of the subject together.
            UsageError: if it is not clear who the subject is.
        """
        motion = self._curves.run(recording, part_of(progress, 0.0, FOLLOWED))
        chosen = designated(self._subject, motion.people)
        progress(FOLLOWED, "fitting the subject")
        people, notices = list(motion.people), list(motion.notices)
        for k, person in enumerate(people):
            if person.id == chosen:
                people[k], misfits = self._fitted(person)
                notices += self._told(misfits)
        progress(1.0, "fitting the subject")
        people = with_subject_id(people, chosen, self._subject.id)
        return replace(motion, people=tuple(people), notices=tuple(notices))

    def _told(self, misfits: Array) -> list[Notice]:
        """Return a notice if the bones of the file do not fit the person."""
        miss = float(np.sqrt(3.0 * misfits.mean()))
        if miss < WIDEST_MISFIT:
            return []
        text = (
            f"the bones of subject {self._subject.id} miss its joints by {1e3 * miss:.0f} mm; correct its "
            "file, or omit segments and keypoints there, so that they are fitted"
        )
        return [Notice("subject.misfit", "warning", text)]

    def _fitted(self, person: PersonCurve) -> tuple[PersonCurve, Array]:
        """Return a person with curves of joint angles, and the misfits of its skeleton."""
        instants = usable_instants(person, self._names)
        joints = certain_joints(person, instants)
        if self._subject.measured:
            skeleton = skeleton_of(self._subject.body, self._names)
        else:
            skeleton = skeleton_from(self._model, self._names, joints)
        fit = fit_freedoms(person, skeleton, self._names, instants, self._arrays)
        fitted, misfits = with_freedoms(person, skeleton, fit)
        return fitted.with_derived(self._derived), misfits
