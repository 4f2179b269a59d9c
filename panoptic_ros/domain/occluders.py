"""Fixed objects in the room that hide people from cameras: walls, tables, pillars."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from panoptic_ros.domain.checks import ShapeChecks
from panoptic_ros.errors import DataError

Array = np.ndarray
_CORNERS = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
_SIDES = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))


@dataclass(frozen=True, slots=True, eq=False)
class Occluders:
    """Two-sided surfaces in the world; they need not be closed.

    Args:
        vertices: (N, 3) m.
        triangles: (M, 3) indices of vertices.
    """

    vertices: Array
    triangles: Array

    def __post_init__(self) -> None:
        shapes = ShapeChecks(self)
        vertices = shapes.store("vertices", np.float64, "N 3")
        triangles = shapes.store("triangles", np.int64, "M 3")
        if not np.isfinite(vertices).all():
            raise DataError("Occluders.vertices is not finite")
        if triangles.size and not 0 <= triangles.min() <= triangles.max() < len(vertices):
            raise DataError(f"Occluders.triangles names vertices that are not among the {len(vertices)}")

    @classmethod
    def box(cls, size: Array, rotation: Array, centre: Array) -> Occluders:
        """Return a box of edges `size` (3,) m along its own axes, the columns of `rotation` (3, 3)."""
        corners = (_CORNERS * size) @ np.asarray(rotation).T + centre
        halves = [half for a, b, c, d in _SIDES for half in ((a, b, c), (a, c, d))]
        return cls(corners, np.array(halves))

    @classmethod
    def joined(cls, parts: Iterable[Occluders]) -> Occluders:
        """Return the union of several occluders."""
        vertices, triangles, count = [np.zeros((0, 3))], [np.zeros((0, 3), np.int64)], 0
        for part in parts:
            vertices.append(part.vertices)
            triangles.append(part.triangles + count)
            count += len(part.vertices)
        return cls(np.concatenate(vertices), np.concatenate(triangles))
