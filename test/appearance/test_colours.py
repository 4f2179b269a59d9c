"""Colours of clothes, on people who are drawn in known colours."""

from dataclasses import replace

import captures
import cv2
import numpy as np
import pytest

from panoptic_ros.appearance.colours import DARK, ColourSamples, colours_of
from panoptic_ros.domain import ViewAppearance, ViewDetections, ViewFrame
from panoptic_ros.errors import DataError
from panoptic_ros.graph.build import configure, make_stage

SKELETON = captures.SKELETON
PATTERN = ColourSamples(SKELETON)
NAMES = SKELETON.joint_names
SHIRT, TROUSERS = (40, 60, 200), (120, 70, 30)  # BGR
FEWEST = 6


def person(x=160.0):
    """A standing person (1, 19, 2) px round a column of an image of 320 x 240."""
    pixels, _ = captures.RIG.cameras[0].project(captures.person((0.0, 0.0), 0.4))
    return ((pixels - pixels.mean(axis=0)) * 0.5 + (x, 120.0))[None]


def drawn(*people, shirt=SHIRT):
    """The image of people (1, 19, 2) in shirts and trousers."""
    image = np.full((240, 320, 3), 190, np.uint8)
    for points in people:
        at = {name: np.rint(point).astype(int) for name, point in zip(NAMES, points[0])}
        for side in "lr":
            for a, b in (("Hip", "Knee"), ("Knee", "Ankle")):
                cv2.line(image, at[side + a].tolist(), at[side + b].tolist(), TROUSERS, 7)
        corners = np.array([at[name] for name in ("lShoulder", "rShoulder", "rHip", "lHip")])
        cv2.fillPoly(image, [cv2.convexHull(corners)], shirt)
    return image


def colour(bgr):
    """As `ViewAppearance` has it."""
    blue, green, red = np.log(np.array(bgr) + DARK)
    return np.array([green, red - green, blue - green])


def test_the_colours_are_those_of_shirt_and_trousers():
    found = colours_of(drawn(person()), person(), PATTERN, FEWEST)
    assert np.allclose(found[0], [colour(SHIRT), colour(TROUSERS)])


def test_what_hides_less_than_half_of_a_shirt_changes_nothing_and_light_changes_the_first_channel_most():
    image = drawn(person())
    left = int(person()[0, NAMES.index("lShoulder"), 0])
    right = int(person()[0, NAMES.index("rShoulder"), 0])
    image[:, min(left, right) : min(left, right) + abs(left - right) // 3] = (0, 255, 0)
    assert np.allclose(colours_of(image, person(), PATTERN, FEWEST)[0, 0], colour(SHIRT))
    dim = colours_of(drawn(person(), shirt=tuple(v // 2 for v in SHIRT)), person(), PATTERN, FEWEST)[0, 0]
    change = np.abs(dim - colour(SHIRT))
    assert change[0] > 0.4 > 2.0 * change[1:].max()


def test_what_is_not_seen_or_may_be_somebody_elses_has_no_colour():
    points = person()
    gone = points.copy()
    gone[0, NAMES.index("lHip")] = np.nan
    found = colours_of(drawn(points), gone, PATTERN, FEWEST)
    assert np.isnan(found[0, 0]).all() and np.allclose(found[0, 1], colour(TROUSERS))  # by the other leg
    near = np.concatenate([points, points + (2.0, 0.0)])
    assert np.isnan(colours_of(drawn(points), near, PATTERN, FEWEST)).all()
    apart = np.concatenate([person(80.0), person(240.0)])
    assert np.isfinite(colours_of(drawn(person(80.0), person(240.0)), apart, PATTERN, FEWEST)).all()
    outside = colours_of(drawn(points), points + (1000.0, 0.0), PATTERN, FEWEST)
    assert np.isnan(outside).all()


def stage():
    return make_stage("appearance", configure({})["appearance"], captures.CONTEXT)


def frame(k, camera="cam0"):
    return ViewFrame(camera, 10**9 + k, k, drawn(person()))


def people(k, points, camera="cam0"):
    scores = np.full(points.shape[:2], 0.9)
    size = (320, 240)
    return ViewDetections(camera, 10**9 + k, k, size, SKELETON.hash, points, scores, scores[:, 0])


def test_every_image_with_people_gives_their_colours_once():
    own = stage()
    assert not own.step(frame(3)).outputs
    (found,) = own.step(people(3, person())).outputs
    assert isinstance(found, ViewAppearance)
    assert (found.camera, found.stamp_ns, found.frame_number) == ("cam0", 10**9 + 3, 3)
    assert np.allclose(found.colours[0, 0], colour(SHIRT), atol=1e-6)
    assert not own.step(people(3, person())).outputs
    own.step(frame(4))
    assert not own.step(people(4, np.zeros((0, 19, 2)))).outputs


def test_people_of_another_image_or_camera_have_no_colours_and_of_another_skeleton_are_refused():
    own = stage()
    own.step(frame(4))
    assert not own.step(people(3, person())).outputs
    assert not own.step(people(4, person(), "cam1")).outputs
    with pytest.raises(DataError, match="of skeleton other, but appearance works on"):
        own.step(replace(people(4, person()), skeleton_hash="other"))


def test_colours_that_no_image_has_are_refused():
    with pytest.raises(DataError, match="infinite"):
        ViewAppearance("cam0", 1, 1, np.full((1, 2, 3), np.inf))
    with pytest.raises(DataError, match="holds 99"):
        ViewAppearance("cam0", 1, 1, np.full((1, 2, 3), 99.0))
