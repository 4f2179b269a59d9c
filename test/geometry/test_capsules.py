"""Surfaces of tapered capsules."""

import numpy as np
import pytest

from panoptic_ros.geometry.capsules import capsule_mesh


@pytest.mark.parametrize("radii", [(0.2, 0.2), (0.3, 0.1), (0.1, 0.3)])
def test_vertices_lie_on_the_surface_that_both_balls_span(radii):
    begin, end = np.array([0.1, -0.2, 0.3]), np.array([0.5, 0.4, 0.9])
    points, normals, triangles = capsule_mesh(begin, end, radii, sides=16, rings=6)
    shares = np.linspace(0, 1, 2001)[:, None]
    centres, sizes = begin + shares * (end - begin), radii[0] + shares[:, 0] * (radii[1] - radii[0])
    gaps = np.linalg.norm(points[:, None] - centres, axis=-1) - sizes
    assert np.abs(gaps.min(axis=1)).max() < 1e-6  # no ball between them holds a vertex, one touches it
    assert np.linalg.norm(normals, axis=1) == pytest.approx(1)
    corners = points[triangles]
    faces = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    big = np.linalg.norm(faces, axis=1) > 1e-9
    assert (np.einsum("ij,ij->i", faces, normals[triangles].mean(1))[big] > 0).all()


def test_width_is_along_y_about_the_axis():
    narrow, _, _ = capsule_mesh(np.zeros(3), np.array([0, 0, 1.0]), (0.1, 0.1))
    wide, _, _ = capsule_mesh(np.zeros(3), np.array([0, 0, 1.0]), (0.1, 0.1), wide=2.0)
    assert wide[:, 1] == pytest.approx(2 * narrow[:, 1])
    assert wide[:, [0, 2]] == pytest.approx(narrow[:, [0, 2]])
