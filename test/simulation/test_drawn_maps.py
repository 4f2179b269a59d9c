"""Maps drawn from 2D people: peaks where the joints are, as high as their scores."""

import numpy as np

from panoptic_ros.domain import ViewDetections
from panoptic_ros.simulation.drawn_maps import MapDrawing, draw_maps


def view(points, scores):
    points, scores = np.array(points, float), np.array(scores, float)
    return ViewDetections("a", 0, 0, (1920, 1080), "x", points, scores, np.ones(len(points)))


def test_maps_show_what_the_people_show():
    drawing = MapDrawing()
    points = [
        [(100.0, 200.0), (np.nan, np.nan), (1919.0, 1079.0)],
        [(900.5, 20.0), (3.0, 3.0), (40.0, 900.0)],
    ]
    scores = [[0.9, 0.0, 0.5], [0.4, 0.7, 0.6]]
    maps = draw_maps(view(points, scores), drawing)
    assert maps.grid_size == (128, 72) and len(maps.joints) == 5
    dense = maps.dense(3) / 255.0
    for person, joint in np.argwhere(np.array(scores) > 0.0):
        x, y = maps.grid_from_image[:, :2] @ points[person][joint] + maps.grid_from_image[:, 2]
        rows, columns = np.mgrid[0:72, 0:128]
        square = (columns - x) ** 2 + (rows - y) ** 2
        expected = scores[person][joint] * np.exp(-square / (2 * 1.3**2))
        near = (square < 9.0) & (expected > drawing.cut + 0.01)
        assert np.abs(dense[joint] - expected)[near].max() < 0.003


def test_nobody_gives_no_patch():
    maps = draw_maps(view(np.zeros((0, 3, 2)), np.zeros((0, 3))), MapDrawing())
    assert len(maps.joints) == 0 and maps.dense(3).max() == 0


def test_the_middle_of_the_image_is_the_middle_of_its_part_of_the_grid():
    affine = MapDrawing((256, 192)).grid_from_image((640, 480))
    assert np.allclose(affine[:, :2] @ [319.5, 239.5] + affine[:, 2], [31.5, 23.5])
