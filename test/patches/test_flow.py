"""2D tracks on images that move by known amounts."""

from dataclasses import replace

import captures
import cv2
import numpy as np
import pytest

from panoptic_ros.domain import ViewDetections, ViewFrame
from panoptic_ros.domain.parts import rigid_parts
from panoptic_ros.errors import DataError
from panoptic_ros.graph.build import configure, make_stage
from panoptic_ros.patches.flow.stage import PointPattern
from panoptic_ros.patches.flow.tracking import alike, followed

SKELETON = captures.SKELETON
STEP = 40_000_000


def texture(size=(240, 320), seed=0):
    noise = np.random.default_rng(seed).normal(size=size)
    smooth = cv2.GaussianBlur(noise, (0, 0), 2.0)
    return np.clip(128 + 60 * smooth / smooth.std(), 0, 255).astype(np.uint8)


def shifted(image, x, y):
    return cv2.warpAffine(
        image, np.array([[1.0, 0, x], [0, 1.0, y]]), image.shape[::-1], flags=cv2.INTER_CUBIC
    )


def person():
    """A standing person in the middle of the image, (1, 19, 2) px."""
    camera = captures.RIG.cameras[0]
    pixels, _ = camera.project(captures.person((0.0, 0.0), 0.4))
    return ((pixels - pixels.mean(axis=0)) * 0.5 + (160.0, 120.0))[None]


def stage(**values):
    return make_stage("flow", configure({"flow": values})["flow"], captures.CONTEXT)


def frame(k, grey):
    return ViewFrame("cam0", 10**9 + k * STEP, k, np.repeat(grey[:, :, None], 3, axis=2))


def people(k, points, size=(320, 240)):
    scores = np.full(points.shape[:2], 0.9)
    return ViewDetections("cam0", 10**9 + k * STEP, k, size, SKELETON.hash, points, scores, scores[:, 0])


def test_points_follow_a_shift_to_a_tenth_of_a_pixel():
    image = texture()
    begins = np.random.default_rng(1).uniform(40, 200, (60, 2))
    ends, information, kept = followed(image, shifted(image, 5.3, -2.7), begins, begins)
    assert len(kept) > 50
    assert np.median(np.abs(ends - begins[kept] - (5.3, -2.7))) < 0.1
    assert (information[:, 0] > 1.0).all() and (information[:, 2] > 1.0).all()


def test_an_edge_tells_the_motion_across_it_alone():
    image = np.full((120, 160), 60, np.uint8)
    image[:, 80:] = 200
    image = cv2.GaussianBlur(image, (0, 0), 1.5)
    _, information, kept = followed(image, image, np.array([[80.0, 60.0]]), np.array([[80.0, 60.0]]))
    assert len(kept) == 1
    assert information[0, 0] > 10.0 and information[0, 2] < 1e-6


def test_points_without_texture_or_outside_of_the_image_say_nothing():
    image = np.full((120, 160), 60, np.uint8)
    begins = np.array([[80.0, 60.0], [2.0, 60.0], [500.0, 60.0]])
    _, information, kept = followed(image, image, begins, begins)
    assert set(kept.tolist()) <= {0} and not information.any()


def test_the_pattern_lies_on_all_parts_of_everybody():
    both = np.concatenate([person(), person() + 60.0])
    points, persons, parts, *_ = PointPattern(SKELETON).lay(both, np.ones((2, 19), bool))
    assert set(persons.tolist()) == {0, 1} and set(parts.tolist()) == set(range(len(rigid_parts(SKELETON))))
    low, high = both[0].min(axis=0) - 20.0, both[0].max(axis=0) + 20.0
    own = points[persons == 0]
    assert ((own > low) & (own < high)).all()


def test_missing_joints_leave_their_parts_out():
    there = np.ones((1, 19), bool)
    there[0, SKELETON.joint("lWrist")] = False
    parts = PointPattern(SKELETON).lay(person(), there).parts
    names = {rigid_parts(SKELETON)[part].name for part in parts.tolist()}
    assert "lElbow-lWrist" not in names and "lShoulder-lElbow" in names
    assert len(PointPattern(SKELETON).lay(person(), there & False).points) == 0


@pytest.mark.parametrize("width", [960, 160])
def test_tracks_lead_from_the_people_of_an_image_to_the_next_one(width):
    own, image = stage(width=width), texture()
    given = []
    for k in range(3):
        given += own.step(frame(k, shifted(image, 3.0 * k, 2.0 * k))).outputs
        given += own.step(people(k, person() + (3.0 * k, 2.0 * k))).outputs
    assert [(item.before_number, item.frame_number) for item in given] == [(0, 1), (1, 2)]
    for item in given:
        assert np.median(item.ends - item.begins, axis=0) == pytest.approx([3.0, 2.0], abs=0.15)
        assert set(item.persons.tolist()) == {0} and item.before_ns + STEP == item.stamp_ns


@pytest.mark.parametrize("broken", ["gap", "size", "nobody", "no people told"])
def test_nothing_is_followed_where_it_cannot_be(broken):
    own, image = stage(longest_gap=0.1), texture()
    own.step(frame(0, image))
    if broken != "no people told":
        own.step(people(0, person()[: broken != "nobody"]))
    late = frame(1, image[:200] if broken == "size" else image)
    late = replace(late, stamp_ns=late.stamp_ns + (200_000_000 if broken == "gap" else 0))
    given = own.step(late).outputs
    assert all(not len(item.parts) for item in given)


def test_old_images_are_told_and_foreign_people_refused():
    own = stage()
    own.step(frame(3, texture()))
    assert [notice.code for notice in own.step(frame(2, texture())).notices] == ["flow.old_stamp"]
    with pytest.raises(DataError, match="skeleton 00"):
        own.step(replace(people(3, person()), skeleton_hash="00"))


@pytest.mark.parametrize("gain", [0.7, 0.93, 1.25])
def test_exposure_that_flickers_changes_nothing(gain):
    image = (0.7 * texture()).astype(np.uint8)
    begins = np.random.default_rng(1).uniform(40, 200, (60, 2))
    later = np.clip(gain * shifted(image, 3.3, -1.7).astype(float), 0, 255).astype(np.uint8)
    ends, information, kept = followed(image, later, begins, begins)
    assert len(kept) > 50 and np.median(np.abs(ends - begins[kept] - (3.3, -1.7))) < 0.1
    assert (information[:, 0] > 1.0).all()


def test_images_of_the_same_exposure_are_left_as_they_are():
    image = texture()
    assert all(one is other for one, other in zip(alike(image, image), (image, image)))
    dark, bright = alike(image, np.zeros_like(image))
    assert dark is image and not bright.any()


def test_blurred_images_say_less_or_nothing():
    image = texture()
    begins = np.random.default_rng(1).uniform(40, 200, (60, 2))
    sharp = followed(image, shifted(image, 5.3, -2.7), begins, begins)
    blurred = followed(image, cv2.blur(shifted(image, 5.3, -2.7), (25, 1)), begins, begins)
    assert blurred[1].sum() < 0.3 * sharp[1].sum()
