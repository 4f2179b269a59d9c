"""Where cameras should see whom tracking follows."""

from dataclasses import replace

import numpy as np
import pytest
from stage_cases import DEPTH, FOCAL, known_people, watching_rig

from panoptic_ros.detection.watching import TrackedPeople

CAMERA = watching_rig().cameras[0]
PLACES = np.array([[[60.0, 40], [70, 90], [65, 150]], [[180.0, 50], [190, 95], [185, 140]]])
SECOND = 10**9


def known(*tracks):
    people = TrackedPeople()
    for each in tracks:
        people.take(each)
    return people


def test_people_are_expected_where_they_are():
    seen = known(known_people(PLACES, SECOND)).seen_by(CAMERA, SECOND)
    np.testing.assert_allclose(seen.pixels[:, :3], PLACES, atol=1e-9)
    assert seen.there.all() and len(seen.heights) == 2
    assert len(seen.regions(220.0, 32)) == 2


def test_they_go_on_as_they_moved_but_not_over_a_gap_or_another_clock():
    tracks = known_people(PLACES, SECOND)
    states = tracks.states.copy()
    states[..., 3] = 1.0  # m/s
    people = known(replace(tracks, states=states))
    shift = 0.1 * FOCAL / DEPTH
    later = people.seen_by(CAMERA, SECOND + 10**8)
    np.testing.assert_allclose(later.pixels[:, :3], PLACES + (shift, 0.0), atol=1e-9)
    for stamp in (SECOND - 1, 50 * SECOND):
        np.testing.assert_allclose(people.seen_by(CAMERA, stamp).pixels[:, :3], PLACES, atol=1e-9)


def test_who_is_behind_the_camera_or_outside_is_in_no_region():
    tracks = known_people(PLACES, SECOND)
    states = tracks.states.copy()
    states[0, :, 2] = -2.0
    states[1, :, 0] += 9.0
    assert known(replace(tracks, states=states)).seen_by(CAMERA, SECOND).regions(220.0, 32) == []


def test_joints_that_are_forgotten_are_looked_for_where_they_were():
    first = known_people(PLACES, SECOND)
    states = first.states.copy()
    states[0] = np.nan
    unseen = np.array([0.3, 0.0])
    people = known(first, replace(first, states=states, stamp_ns=SECOND + 10**8, unseen=unseen))
    seen = people.seen_by(CAMERA, SECOND + 10**8)
    np.testing.assert_allclose(seen.pixels[0, :3], PLACES[0], atol=1e-9)
    assert seen.doubts[0] > 10.0 * seen.doubts[1]
    late = replace(first, states=states, unseen=np.array([2.5, 0.0]))
    assert len(known(first, late).seen_by(CAMERA, SECOND).pixels) == 1


def test_places_where_people_appear_are_doors():
    first = known_people(PLACES, SECOND)
    people = known(known_people(PLACES[:1], SECOND // 2), first)
    assert people.doors == [] and not people.is_door(CAMERA)  # they were there from the beginning
    people = known(known_people(PLACES[:1], 0), first, first)
    assert len(people.doors) == 1 and people.is_door(CAMERA)
    np.testing.assert_allclose(people.doors[0], first.states[1, :, :3].mean(axis=0))


@pytest.mark.parametrize(("shift", "strange"), [(0.0, False), (15.0, False), (60.0, True)])
def test_a_stranger_is_nobody_who_is_expected(shift, strange):
    seen = known(known_people(PLACES[:1], SECOND)).seen_by(CAMERA, SECOND)
    points = np.concatenate([PLACES[:1], PLACES[:1].mean(axis=1, keepdims=True)], axis=1) + (shift, 0.0)
    assert seen.strangers(points, np.ones((1, 4))).tolist() == [strange]


CROWD = np.array([PLACES[0], PLACES[0] + (25.0, 5.0)])


def two_d(*people):
    """2D people of three joints and a fourth between them, as those that are expected."""
    points = np.array([[*person, np.mean(person, axis=0)] for person in people]).reshape(-1, 4, 2)
    return points, np.ones(points.shape[:2])


def test_a_crowd_lacks_somebody_who_is_not_found():
    seen = known(known_people(CROWD, SECOND)).seen_by(CAMERA, SECOND)
    assert seen.lacking(*two_d(*CROWD)) == []
    (crowd,) = seen.lacking(*two_d(CROWD[1]))
    assert sorted(crowd.people) == [0, 1]
    assert len(seen.lacking(*two_d(CROWD[1], CROWD[1] + 1.0))) == 1  # one who is found twice is not two
    loose = known(known_people(PLACES, SECOND)).seen_by(CAMERA, SECOND)
    assert loose.lacking(*two_d()) == []


def test_of_a_second_look_those_count_who_were_missing_and_those_near_nobody():
    seen = known(known_people(CROWD, SECOND)).seen_by(CAMERA, SECOND)
    first = two_d(CROWD[0] + 1.0)
    second = two_d(CROWD[0] - 2.0, CROWD[1] + 1.0, CROWD[1] - 3.0, CROWD[1] + (60.0, 0.0))
    assert seen.further(first, second).tolist() == [1, 3]
    assert seen.further(first, two_d()).tolist() == []


def test_without_tracks_everybody_is_a_stranger():
    people = TrackedPeople()
    seen = people.seen_by(CAMERA, SECOND)
    assert people.nobody and seen.strangers(np.zeros((2, 4, 2)), np.ones((2, 4))).all()
