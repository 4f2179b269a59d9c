"""A person while data come."""

from dataclasses import replace

import numpy as np
from bodies import BODY
from captures import RIG, SKELETON

from panoptic_ros.domain.subjects import Subject
from panoptic_ros.io.pose_prior import read_prior
from panoptic_ros.kinematics.body.tracker import SubjectTracker
from panoptic_ros.kinematics.config import KinematicsConfig
from panoptic_ros.kinematics.people.person import PersonState


def somebody():
    return PersonState(KinematicsConfig(), Subject(0, BODY), read_prior(""), RIG, SKELETON.joint_names)


def test_the_body_has_the_lengths_that_were_learnt():
    person, longer = somebody(), replace(BODY, offsets=1.1 * BODY.offsets)
    np.testing.assert_array_equal(person.body.offsets, BODY.offsets)
    person.tracker = SubjectTracker(KinematicsConfig(), person.subject, person.weighing, {})
    person.tracker.take_body(longer)  # as it does once motion has told
    np.testing.assert_array_equal(person.body.offsets, longer.offsets)


def test_whoever_is_measured_anew_goes_on_with_these_lengths():
    person, longer = somebody(), replace(BODY, offsets=1.1 * BODY.offsets)
    person.take_body(longer)
    assert person.body is longer
    person.tracker = SubjectTracker(KinematicsConfig(), person.subject, person.weighing, {})
    person.take_body(BODY)
    np.testing.assert_array_equal(person.tracker.offsets, BODY.offsets)
    np.testing.assert_array_equal(person.weighing.sites[2], somebody().weighing.sites[2])
