"""Surface meshes of tapered capsules."""

from __future__ import annotations

import numpy as np

Array = np.ndarray
SIDES, RINGS = 12, 4  # facets about the axis, and rings of each half sphere


def capsule_mesh(
    begin: Array,
    end: Array,
    radii: tuple[float, float],
    wide: float = 1.0,
    sides: int = SIDES,
    rings: int = RINGS,
) -> tuple[Array, Array, Array]:
    """Return the mesh of a tapered capsule: two half spheres and the surface between them.

    Args:
        begin, end: (3,) centres of the spheres.
        radii: Radii of the spheres.
        wide: Scale factor along y, relative to the axis.
        sides: Number of facets about the axis.
        rings: Number of rings of each half sphere.

    Returns:
        vertices (V, 3), normals (V, 3) of length 1, triangles (T, 3) counter-clockwise from outside.
    """
    axis = np.asarray(end, float) - begin
    length = float(np.linalg.norm(axis))
    up = axis / length if length > 1e-9 else np.array([0.0, 0.0, 1.0])
    side = np.eye(3)[np.argmin(np.abs(up))]
    first = np.cross(up, side)
    first /= np.linalg.norm(first)
    second = np.cross(up, first)
    # lines that touch both spheres leave the axis at this angle
    tilt = np.arcsin(np.clip((radii[0] - radii[1]) / max(length, 1e-9), -0.999, 0.999))
    heights = np.concatenate(
        [np.linspace(-np.pi / 2, tilt, rings + 1), np.linspace(tilt, np.pi / 2, rings + 1)]
    )
    ball = np.repeat([0, 1], rings + 1)
    turns = 2 * np.pi * np.arange(sides) / sides
    around = np.cos(turns)[:, None] * first + np.sin(turns)[:, None] * second  # (sides, 3)
    normals = np.cos(heights)[:, None, None] * around + np.sin(heights)[:, None, None] * up
    centres = np.array([np.asarray(begin, float), np.asarray(end, float)])[ball]
    vertices = centres[:, None] + np.array(radii)[ball][:, None, None] * normals
    middle = 0.5 * (centres[0, 1] + centres[-1, 1])
    vertices[..., 1] = middle + wide * (vertices[..., 1] - middle)
    normals[..., 1] /= wide
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    rows, columns = np.meshgrid(np.arange(2 * rings + 1), np.arange(sides), indexing="ij")
    a, b = rows * sides + columns, rows * sides + (columns + 1) % sides
    c, d = a + sides, b + sides
    triangles = np.concatenate([np.stack([a, b, d], -1), np.stack([a, d, c], -1)]).reshape(-1, 3)
    return vertices.reshape(-1, 3), normals.reshape(-1, 3), triangles
