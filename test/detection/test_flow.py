"""People are carried along with the picture, and lost where it does not show them any more."""

import cv2
import numpy as np
import pytest

from panoptic_ros.detection.flow import carried, is_cut, remembered
from panoptic_ros.detection.people import DetectedPeople, no_people

SIZE = (480, 640)


def texture(seed=0):
    rng = np.random.default_rng(seed)
    coarse = rng.uniform(0, 255, (48, 64, 3)).astype(np.float32)
    return np.clip(cv2.resize(coarse, SIZE[::-1], interpolation=cv2.INTER_CUBIC), 0, 255).astype(np.uint8)


def moved(image, dx, dy):
    shift = np.array([[1.0, 0.0, dx], [0.0, 1.0, dy]])
    return cv2.warpAffine(image, shift, image.shape[1::-1], borderMode=cv2.BORDER_REFLECT)


def people(places, scores=None):
    places = np.asarray(places, float)
    scores = np.full(places.shape[:2], 0.8) if scores is None else np.asarray(scores, float)
    boxes = np.concatenate([places.min(axis=1), places.max(axis=1)], axis=1)
    return DetectedPeople(places, scores, np.full(len(places), 0.5), boxes)


PLACES = np.array(
    [[[100, 100], [150, 200], [120, 300], [180, 260]], [[400, 90], [450, 200], [420, 310], [380, 250]]]
)


def with_people(image, stamp_ns, found):
    memory = remembered(image, stamp_ns)
    return type(memory)(memory.grey, memory.scale, stamp_ns, found, stamp_ns)


@pytest.mark.parametrize("size", [(640, 480), (1280, 720), (200, 150)])
def test_the_memory_is_small_and_knows_its_scale(size):
    memory = remembered(np.zeros((size[1], size[0], 3), np.uint8), 5)
    assert memory.grey.shape[1] == min(size[0], 320) and memory.scale == size[0] / memory.grey.shape[1]


@pytest.mark.parametrize(("dx", "dy"), [(0, 0), (6, -4), (-13, 9)])
def test_joints_follow_the_picture(dx, dy):
    image = texture()
    found = carried(with_people(image, 0, people(PLACES)), remembered(moved(image, dx, dy), 1))
    assert (found.scores == 0.8).all()
    np.testing.assert_allclose(found.points, PLACES + (dx, dy), atol=0.5)
    np.testing.assert_array_equal(found.person_scores, [0.5, 0.5])


@pytest.mark.parametrize("dx", [4, 8])
def test_thin_limbs_do_not_take_the_background_along(dx):
    before, later, limb, left, wide = texture(1), texture(1), texture(2), 300, 24  # 12 px of the grey image
    before[60:420, left : left + wide] = limb[60:420, left : left + wide]
    later[60:420, left + dx : left + dx + wide] = limb[60:420, left : left + wide]
    joints = np.array([[[left + wide / 2, y] for y in (120, 200, 280, 360)]])
    found = carried(with_people(before, 0, people(joints)), remembered(later, 1))
    assert (found.scores > 0.0).all()
    np.testing.assert_allclose(found.points, joints + (dx, 0), atol=0.1)


def test_what_is_covered_is_lost_and_missing_joints_stay_missing():
    image = texture()
    scores = np.full((2, 4), 0.8)
    scores[1, 0] = 0.0
    later = image.copy()
    later[60:340, 60:220] = texture(9)[60:340, 60:220]  # something else is where the first person was
    found = carried(with_people(image, 0, people(PLACES, scores)), remembered(later, 1))
    assert len(found) == 1
    np.testing.assert_array_equal(found.scores, [[0.0, 0.8, 0.8, 0.8]])


def test_nobody_is_carried_into_another_scene():
    image = texture()
    before, now = with_people(image, 0, people(PLACES)), remembered(texture(7), 1)
    assert carried(before, now) is None


def test_a_cut_is_seen_and_motion_or_noise_is_none():
    image = texture()
    noisy = np.clip(image + np.random.default_rng(1).normal(0, 8, image.shape), 0, 255).astype(np.uint8)
    before = remembered(image, 0)
    assert is_cut(before, remembered(255 - image, 1))
    assert is_cut(before, remembered(cv2.resize(image, (320, 200)), 1))
    assert not is_cut(before, remembered(noisy, 1))
    assert not is_cut(before, remembered(moved(image, 3, 3), 1))


def test_an_empty_picture_stays_empty():
    image = texture()
    assert len(carried(with_people(image, 0, no_people(4)), remembered(image, 1))) == 0
    assert carried(remembered(image, 0), remembered(image, 1)) is None  # nobody looked


def test_nothing_given_is_changed():
    image, found = texture(), people(PLACES)
    before = with_people(image, 0, found)
    carried(before, remembered(moved(image, 4, 0), 1))
    np.testing.assert_array_equal(found.points, PLACES)
    assert (found.scores == 0.8).all()
