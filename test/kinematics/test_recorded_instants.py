"""People between two images are on the line between them, each with himself."""

import numpy as np

from panoptic_ros.domain.subjects import ViewPeople, ViewSeries
from panoptic_ros.kinematics.recorded_instants import views_at

FIRST, PERIOD, HALF = 1_700_000_000_000_000_000, 40_000_000, 8_333_333
SHAPE = np.random.default_rng(4).uniform(-0.2, 0.2, (19, 2))


def image(*places):
    points = np.array([SHAPE + [x, 0.1] for x in places]).reshape(-1, 19, 2)
    return ViewPeople(points, np.full(points.shape[:2], 0.8))


def seen(images, *shares):
    stamps = FIRST + PERIOD * np.arange(len(images))
    return views_at(ViewSeries(stamps, images), FIRST + np.array([round(s * PERIOD) for s in shares]), HALF)


def places(people):
    return np.sort((people.points - SHAPE)[..., 0].mean(1))


def test_joints_are_on_the_line_between_two_images_and_at_an_image_as_they_are():
    images = (image(0.0), image(0.04), image(0.06))
    found = seen(images, 0.0, 0.25, 0.75, 1.0, 1.5)
    assert np.allclose([places(one) for one in found], [[0.0], [0.01], [0.03], [0.04], [0.05]])
    assert found[0] is images[0] and found[3] is images[1]
    assert np.allclose(found[1].scores, 0.8)


def test_two_people_are_told_apart_whatever_their_order():
    (found,) = seen((image(0.0, 0.5), image(0.48, 0.04)), 0.5)
    assert np.allclose(places(found), [0.02, 0.49])


def test_who_is_in_one_image_alone_counts_near_to_it():
    near, far = seen((image(0.0, 0.9), image(0.0)), 0.1, 0.5)
    assert np.allclose(places(near), [0.0, 0.9]) and np.allclose(places(far), [0.0])


def test_a_joint_of_one_image_counts_near_to_it():
    later = image(0.04)
    later.points[0, 3] = np.nan
    later.scores[0, 3] = 0.0
    near, far = seen((image(0.0), later), 0.1, 0.5)
    assert np.allclose(near.points[0, 3], SHAPE[3] + [0.0, 0.1]) and near.scores[0, 3] == 0.8
    assert np.isnan(far.points[0, 3]).all() and far.scores[0, 3] == 0.0


def test_there_is_nobody_between_images_that_are_too_far_apart_nor_before_and_after_all():
    stamps = FIRST + np.array([0, 200_000_000])
    instants = FIRST + np.array([-20_000_000, -5_000_000, 5_000_000, 90_000_000, 300_000_000])
    found = views_at(ViewSeries(stamps, (image(0.0), image(0.1))), instants, HALF)
    assert [one is None for one in found] == [True, False, False, True, True]
    assert seen((image(), image()), 0.5)[0].points.shape == (0, 19, 2)
    assert views_at(ViewSeries(np.zeros(0, np.int64), ()), instants, HALF) == [None] * 5
