"""Curves of joint angles on exact simulated truth."""

from dataclasses import replace

import numpy as np
import pytest
from free_cameras import START_NS
from hinged_people import BODIES, MODEL, NAMES, HingedCapture

from panoptic_ros.continuous.config import ContinuousConfig
from panoptic_ros.continuous.designated import with_subject_id
from panoptic_ros.continuous.passes import ContinuousPass
from panoptic_ros.continuous.subjects.passes import SubjectPass
from panoptic_ros.domain.subjects import Subject
from panoptic_ros.errors import UsageError
from panoptic_ros.evaluation.ellipsoids import ELLIPSOID_95
from panoptic_ros.stage import untold

TIMES = np.arange(0.3, 1.3, 0.013)  # between the samples of all cameras
LIMBS = (("lShoulder", "lElbow"), ("rElbow", "rWrist"), ("lHip", "lKnee"), ("rKnee", "rAnkle"))


def solved(capture, subject):
    context = replace(capture.context, extras={"segments": MODEL})
    return SubjectPass(ContinuousConfig(), context, subject).run(capture.recording, untold)


def lengths(person, one, other):
    """Distance (T,) m of two joints over the whole curve of a person."""
    joints = person.at(np.linspace(person.seen[0], person.seen[-1], 300))
    return np.linalg.norm(joints[:, NAMES.index(one)] - joints[:, NAMES.index(other)], axis=1)


def of(capture, person, **values):
    return Subject(0, BODIES[person], start=capture.joints(0.0)[person].mean(axis=0), **values)


@pytest.fixture(scope="module")
def capture():
    return HingedCapture(seconds=1.6)


@pytest.fixture(scope="module")
def free(capture):
    return ContinuousPass(ContinuousConfig(), capture.context).run(capture.recording, untold)


@pytest.fixture(scope="module")
def motion(capture):
    return solved(capture, of(capture, 1))


def test_a_known_body_halves_the_error_of_free_curves(capture, free, motion):
    before, after = (capture.errors(found, TIMES) for found in (free, motion))
    assert np.isfinite(after).all()
    assert after[1].mean() < 0.8 * before[1].mean() and after[1].max() < before[1].max()


def test_bones_keep_the_lengths_of_the_file(motion, free):
    known = np.linalg.norm(BODIES[1].offsets[MODEL.index("rFoot")])
    (person,) = (one for one in motion.people if abs(lengths(one, "rKnee", "rAnkle")[0] - known) < 1e-4)
    assert max(np.ptp(lengths(person, *limb)) for limb in LIMBS) < 1e-4
    before = free.people[[one.id for one in motion.people].index(person.id)]
    assert min(np.ptp(lengths(before, *limb)) for limb in LIMBS) > 1e-3


def test_bystanders_stay_as_they_are(motion, free):
    same = [np.array_equal(a.points, b.points) for a, b in zip(motion.people, free.people)]
    assert sorted(same) == [False, True]
    fitted = same.index(False)
    assert motion.people[fitted].id == 0  # that of the subject
    assert motion.people[1 - fitted].id == free.people[1 - fitted].id + 1


def test_bones_are_fitted_if_the_file_states_a_stature_alone(capture, free):
    subject = replace(of(capture, 1, measured=False), body=MODEL.body(1.6))
    found = solved(capture, subject)
    before, after = (capture.errors(one, TIMES)[1].mean() for one in (free, found))
    assert after < 1.1 * before


def test_motion_without_noise_is_exact_up_to_the_knots():
    exact = HingedCapture(seconds=1.6, noise_px=0.0, there=lambda person, time: person == 1)
    assert np.nanmean(exact.errors(solved(exact, of(exact, 1)), TIMES)) < 0.001


def test_ellipsoids_hold_the_noise(capture, motion):
    stamps = [START_NS + round(1e9 * time) for time in TIMES]
    truth = np.stack([capture.joints(time)[1] for time in TIMES])
    distances = []
    for bodies, joints in zip(motion.sets(stamps), truth):
        nearest = np.abs(bodies.positions - joints).sum(axis=(1, 2)).argmin()
        gaps = bodies.positions[nearest] - joints
        solved_gaps = np.linalg.solve(bodies.covariances[nearest], gaps[..., None])[..., 0]
        distances.append((gaps * solved_gaps).sum(axis=-1))
    assert 0.85 < (np.array(distances) < ELLIPSOID_95).mean() < 1.0


def test_a_subject_who_is_not_always_seen_is_followed_past_the_gap():
    gap = HingedCapture(seconds=2.1, there=lambda person, time: person == 0 and not 0.8 < time < 1.2)
    errors = gap.errors(solved(gap, of(gap, 0)), np.arange(1.4, 1.9, 0.02))[0]
    assert np.isfinite(errors).all() and errors.mean() < 0.006


def test_the_subject_among_several_people_needs_a_start(capture):
    with pytest.raises(UsageError, match="2 people are there; state the subject's start"):
        solved(capture, Subject(0, BODIES[0]))


def test_nobody_else_has_the_id_of_the_subject(free):
    other = with_subject_id(free.people, free.people[0].id, 7)
    assert sorted(person.id for person in other) == [free.people[1].id, 7]
    assert [person.id for person in with_subject_id(free.people, -1, 0)] == [p.id + 1 for p in free.people]
