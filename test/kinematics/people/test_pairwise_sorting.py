"""Algorithm 1 of Malleson et al. 2020: who of the 2D people is whom, and its limits."""

import numpy as np
import pytest
from captures import RIG, person

from panoptic_ros.domain.subjects import InstantViews, ViewPeople
from panoptic_ros.kinematics.people.pairwise_sorting import MOVEMENT, PairwiseSorter

CAMERAS = range(len(RIG.cameras))
ONE, TWO, BYSTANDER = (0.0, 0.0), (1.2, 0.3), (-0.9, 1.5)


def middle(place):
    return np.nanmedian(person(place, 0.3), axis=0)


def seen(places, seed=0, unseen=()):
    """Views of people in an order of their own, and in each view the row of every place; `unseen`: pairs of
    camera and place."""
    views, rows = {}, {}
    for c, camera in enumerate(RIG.cameras):
        there = [k for k in range(len(places)) if (c, k) not in unseen]
        order = [int(k) for k in np.random.default_rng([seed, c]).permutation(there)]
        pixels = [camera.project(person(places[k], 0.3))[0] for k in order]
        plane = np.array([camera.intrinsics.undistort(joints) for joints in pixels])
        views[c] = ViewPeople(plane, np.ones(plane.shape[:2]))
        rows |= {(c, k): order.index(k) for k in there}
    return InstantViews(0, views), rows


def sorter(*starts):
    return PairwiseSorter(RIG, [None if start is None else middle(start) for start in starts])


def assert_is(found, instant, rows, place, cameras=CAMERAS):
    assert sorted(found) == list(cameras)
    for c in cameras:
        np.testing.assert_array_equal(found[c][0], instant.views[c].points[rows[c, place]])


def test_subjects_have_their_own_2d_people_and_bystanders_are_left_out():
    instant, rows = seen((BYSTANDER, TWO, ONE))
    one, two = sorter(ONE, TWO).sort(instant, [None, None])
    assert_is(one, instant, rows, 2)
    assert_is(two, instant, rows, 1)


def test_subjects_are_followed_from_where_they_were_last_seen():
    found = sorter(ONE)
    for step in range(8):
        instant, rows = seen((TWO, (-0.5 * step, 0.0)), seed=step)
        assert_is(found.sort(instant, [None])[0], instant, rows, 1)
    nobody, _ = seen((TWO,))
    assert found.sort(nobody, [None]) == [{}]
    instant, rows = seen(((-3.5, 0.0), TWO))
    assert_is(found.sort(instant, [None])[0], instant, rows, 0)


@pytest.mark.parametrize(("far", "is_taken"), [(MOVEMENT - 0.1, True), (MOVEMENT + 0.1, False)])
def test_nobody_moves_farther_than_the_limit(far, is_taken):
    instant, _ = seen(((far, 0.0),))
    assert bool(sorter(ONE).sort(instant, [None])[0]) == is_taken


def test_who_is_seen_by_one_camera_alone_is_not_told():
    hidden = [(c, 0) for c in CAMERAS if c]
    instant, _ = seen((ONE,), unseen=hidden)
    assert sorter(ONE).sort(instant, [None]) == [{}]
    instant, rows = seen((ONE,), unseen=hidden[1:])
    assert_is(sorter(ONE).sort(instant, [None])[0], instant, rows, 0, CAMERAS[:2])


def test_a_2d_person_that_no_other_view_confirms_is_left_out():
    instant, rows = seen((ONE,))
    camera = RIG.cameras[1]
    away = 0.05 * camera.image_size[0] / camera.intrinsics.matrix[0, 0]  # three times what is allowed
    instant.views[1].points[...] += [0.0, away]
    assert_is(sorter(ONE).sort(instant, [None])[0], instant, rows, 0, [c for c in CAMERAS if c != 1])


def test_without_a_start_the_body_itself_tells_where_somebody_is():
    instant, rows = seen((TWO, ONE))
    found = sorter(None)
    assert found.sort(instant, [None]) == [{}]
    assert_is(found.sort(instant, [middle(ONE)])[0], instant, rows, 1)
