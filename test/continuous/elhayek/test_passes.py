"""The whole pass on exact simulated truth."""

from dataclasses import replace

import numpy as np
import pytest
from hinged_people import BODIES, MODEL, NAMES, HingedCapture

from panoptic_ros.continuous.config import ContinuousConfig
from panoptic_ros.continuous.elhayek.passes import ElhayekPass, slowest_period
from panoptic_ros.domain.subjects import Subject
from panoptic_ros.errors import UsageError
from panoptic_ros.stage import untold

TIMES = np.arange(0.3, 1.3, 0.013)  # between the samples of all cameras


def solved(capture, subject=None, progress=untold):
    context = replace(capture.context, extras={"segments": MODEL})
    return ElhayekPass(ContinuousConfig(), context, subject).run(capture.recording, progress)


def length(person, one, other):
    """Distance (T,) m of two joints over the whole curve of a person."""
    joints = person.at(np.linspace(person.seen[0], person.seen[-1], 200))
    return np.linalg.norm(joints[:, NAMES.index(one)] - joints[:, NAMES.index(other)], axis=1)


@pytest.fixture(scope="module")
def capture():
    return HingedCapture(seconds=1.6)


@pytest.fixture(scope="module")
def motion(capture):
    return solved(capture)


def test_motion_between_samples_is_exact_up_to_the_noise(capture, motion):
    errors = capture.errors(motion, TIMES)
    assert np.isfinite(errors).all() and errors.mean() < 0.006 and errors.max() < 0.06
    assert slowest_period(motion.people) == pytest.approx(0.1)


def test_motion_without_noise_is_exact_up_to_the_polynomials():
    exact = HingedCapture(seconds=1.6, noise_px=0.0, there=lambda person, time: person == 1)
    assert np.nanmean(exact.errors(solved(exact), TIMES)) < 0.002


def test_bones_keep_their_length(motion):
    for person in motion.people:
        assert np.ptp(length(person, "lShoulder", "lElbow")) < 1e-3
        assert np.ptp(length(person, "rKnee", "rAnkle")) < 1e-3


def test_progress_never_goes_back_and_ends_at_1():
    shares = []
    solved(HingedCapture(seconds=0.8), progress=lambda share, doing: shares.append(share))
    assert shares == sorted(shares) and shares[-1] == 1.0 and len(shares) > 10


def test_a_known_skeleton_is_that_of_the_subject_alone(capture):
    start = capture.joints(0.0)[1].mean(axis=0)
    found = solved(capture, Subject(7, BODIES[1], start=start)).people
    known = np.linalg.norm(BODIES[1].offsets[MODEL.index("rFoot")])
    gaps = [abs(length(person, "rKnee", "rAnkle").mean() - known) for person in found]
    assert sorted(person.id for person in found)[1] == 7
    assert [gap < 1e-4 for gap in gaps] == [person.id == 7 for person in found]
    with pytest.raises(UsageError, match="2 people are there; state the subject's start"):
        solved(capture, Subject(0, BODIES[0]))


def test_a_person_is_found_again_after_a_gap():
    gap = HingedCapture(seconds=2.1, there=lambda person, time: person == 0 and not 0.7 < time < 1.3)
    errors = gap.errors(solved(gap), np.arange(1.5, 1.9, 0.02))[0]
    assert np.isfinite(errors).all() and errors.mean() < 0.008
