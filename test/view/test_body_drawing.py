"""Bodies drawn as bodies."""

import captures
import numpy as np
import pytest
from bodies import BODY, MODEL

from panoptic_ros.io.body_models import read_body_shape
from panoptic_ros.view.body_drawing import BodySurfaces, DrawnBody, ShapedBodies, draw_bodies
from panoptic_ros.view.overlay import draw_view

SHAPE = read_body_shape(MODEL)


def standing(number=1, at=(0.0, 0.0, 1.0)):
    """A body in a T at a place."""
    places = np.zeros((len(MODEL.names), 3))
    for s, above in enumerate(MODEL.parents.tolist()):
        places[s] = at if above < 0 else places[above] + BODY.offsets[s]
    return DrawnBody(0, number, places, np.tile(np.eye(3), (len(places), 1, 1)), BODY.offsets)


def test_the_surface_is_as_tall_and_as_wide_as_a_person():
    points, normals, triangles = BodySurfaces(SHAPE).place(standing())
    low, high = points.min(0), points.max(0)
    assert high[2] - low[2] == pytest.approx(1.75, abs=0.08)
    assert 1.5 < high[1] - low[1] < 1.95 and 0.15 < high[0] - low[0] < 0.45
    assert len(points) == len(normals) and triangles.max() < len(points)


def test_it_covers_where_the_body_is_in_the_image():
    camera = captures.RIG.cameras[0]
    width, height = camera.image_size
    canvas = np.zeros((height, width, 3), np.uint8)
    body = standing(at=captures.people(0.0)[0].mean(axis=0))
    draw_bodies(canvas, camera, ShapedBodies([body], BodySurfaces(SHAPE)), [(255, 255, 255)], 1.0)
    drawn = canvas.max(axis=2) > 0
    middle = camera.project(0.5 * (body.places + body.places[MODEL.parents]))[0][1:]
    inside = np.round(middle[camera.contains(middle)]).astype(int)
    assert len(inside) > 10 and drawn[inside[:, 1], inside[:, 0]].mean() > 0.9
    rows, columns = np.nonzero(drawn)
    points, _, _ = BodySurfaces(SHAPE).place(body)
    pixels = camera.project(points)[0]
    assert columns.min() >= pixels[:, 0].min() - 2 and rows.max() <= pixels[:, 1].max() + 2


def test_the_nearer_of_two_is_in_front():
    camera = captures.RIG.cameras[0]
    axis = camera.cam_from_world.rotation[2]
    at = camera.centre + 3.0 * axis
    near, far = standing(1, at), standing(2, at + 1.0 * axis)
    pictures = []
    for order in ((near, far), (far, near)):
        canvas = np.zeros((*camera.image_size[::-1], 3), np.uint8)
        colors = [(0, 0, 255) if body.id == 1 else (0, 255, 0) for body in order]
        draw_bodies(canvas, camera, ShapedBodies(order, BodySurfaces(SHAPE)), colors, 1.0)
        pictures.append(canvas)
    assert (pictures[0] == pictures[1]).all()
    x, y = np.round(camera.project(near.places[1])[0]).astype(int)
    assert pictures[0][y, x, 2] > 0 and pictures[0][y, x, 1] == 0


def test_without_bodies_pictures_are_as_before():
    camera = captures.RIG.cameras[0]
    image = np.full((*camera.image_size[::-1], 3), 90, np.uint8)
    plain = draw_view(image, camera, None, captures.SKELETON)
    nobody = ShapedBodies([], BodySurfaces(SHAPE))
    assert (draw_view(image, camera, None, captures.SKELETON, bodies=nobody) == plain).all()
