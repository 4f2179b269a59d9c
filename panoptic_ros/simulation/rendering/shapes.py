"""Round cones, the shapes that bodies consist of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np

Array = np.ndarray


class Material(IntEnum):
    """Paint of a surface."""

    PLAIN = 0
    CLOTH = 1  # with folds
    STRIPES = 2  # cloth with stripes
    FACE = 3  # eyes, brows and mouth on skin
    HAIR = 4  # open at the face and the neck


@dataclass(frozen=True, eq=False)
class Shapes:
    """N round cones at T instants.

    In its own frame, a cone has a sphere of radius `radii[0]` at the origin and one of `radii[1]` at (0, 0,
    length). If `local_from_world` squashes the cone, lengths are those of the squashed frame.

    Args:
        local_from_world: Transforms (T, N, 3, 3).
        origins: Origins (T, N, 3) m, world.
        lengths: Lengths (T, N) m.
        radii: Radii (N, 2) m.
        colours: Colours (N, 3) BGR 0..255.
        materials, people: Material and person (N,) int.
        seeds: Random phase (N,) of the folds.
        bounds: Radius (N,) m of spheres at both ends that contain the whole shape.
    """

    local_from_world: Array
    origins: Array
    lengths: Array
    radii: Array
    colours: Array
    materials: Array
    people: Array
    seeds: Array
    bounds: Array

    @classmethod
    def join(cls, parts: Sequence[Shapes]) -> Shapes:
        """Return all shapes of all people."""
        over_time = ("local_from_world", "origins", "lengths")
        names = ("radii", "colours", "materials", "people", "seeds", "bounds")
        joined = [np.concatenate([getattr(p, name) for p in parts], axis=1) for name in over_time]
        joined += [np.concatenate([getattr(p, name) for p in parts]) for name in names]
        return cls(*joined)


@dataclass
class ShapeBuilder:
    """Builder of the shapes of one person; `scale` (m per m of an adult) applies to all radii."""

    person: int
    scale: float
    _rows: list[tuple[Array, ...]] = field(default_factory=list)

    def add(
        self,
        start: Array,
        end: Array,
        radii: tuple[float, float],
        colour: Array,
        material: Material = Material.PLAIN,
        axes: Array | None = None,
        squash: tuple[float, float, float] = (1.0, 1.0, 1.0),
    ) -> None:
        """Add a round cone from `start` (T, 3) to `end` (T, 3) m with these radii (m, for an adult).

        Args:
            axes: Local axes as columns (T, 3, 3), the last one along the cone. None derives them from the
                ends.
            squash: Factors that squash the cone along `axes`.
        """
        if axes is None:
            axes = _axes_along(end - start)
        squeeze = np.array(squash)
        local_from_world = axes.swapaxes(-1, -2) / squeeze[:, None]
        length = np.maximum((local_from_world @ (end - start)[..., None])[:, 2, 0], 1e-4)
        scaled = self.scale * np.array(radii)
        seed = 1.7 * len(self._rows) + self.person
        self._rows.append(
            (
                local_from_world,
                start,
                length,
                scaled,
                np.asarray(colour, np.float64),
                np.array(int(material)),
                np.array(self.person),
                np.array(seed),
                np.array(scaled.max() * squeeze.max()),
            )
        )

    def shapes(self) -> Shapes:
        """Return the added shapes."""
        columns = list(zip(*self._rows))
        over_time = [np.stack(column, axis=1) for column in columns[:3]]
        return Shapes(*over_time, *(np.stack(column) for column in columns[3:]))


def _axes_along(direction: Array) -> Array:
    """Return rotations (T, 3, 3) with last column along `direction` (T, 3); upright for a zero direction."""
    length = np.linalg.norm(direction, axis=-1, keepdims=True)
    z = np.where(length > 1e-9, direction / np.maximum(length, 1e-9), [0.0, 0.0, 1.0])
    side = np.where(np.abs(z[:, :1]) < 0.8, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0])
    x = np.cross(side, z)
    x /= np.linalg.norm(x, axis=-1, keepdims=True)
    return np.stack([x, np.cross(z, x), z], axis=-1)
