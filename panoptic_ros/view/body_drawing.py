"""Bodies drawn as bodies: shaded surfaces of their segments, in pictures and in plots."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np

from panoptic_ros.domain import BodyStateSet, Camera
from panoptic_ros.domain.body_shape import BodyShape
from panoptic_ros.geometry.capsules import capsule_mesh
from panoptic_ros.geometry.rotations import from_quaternions

Array = np.ndarray
SIDES, RINGS = 10, 2  # of capsules
OPACITY = 0.7  # over an image
LIGHT = np.array([0.35, 0.25, 0.9]) / np.linalg.norm([0.35, 0.25, 0.9])  # where it comes from, in the world
AMBIENT = 0.45  # share of light from everywhere
FAR = 1e5  # px; triangles that reach farther are not drawn
BITS = 4  # of pixels' fractions
NEAR_NS = 50_000_000  # a body is drawn into an image that is at most so far from it in time
LENGTH_M = 0.002  # by which lengths may differ from those of a surface that is there


class DrawnBody(NamedTuple):
    """A body of an instant: its places (S, 3) m and frames (S, 3, 3), world from segment, and its lengths,
    offsets (S, 3) m."""

    stamp_ns: int
    id: int
    places: Array
    frames: Array
    offsets: Array


def drawn_bodies(item: BodyStateSet) -> list[DrawnBody]:
    """The bodies of an instant."""
    return [
        DrawnBody(
            item.stamp_ns, number, item.positions[k], from_quaternions(item.orientations[k]), item.offsets[k]
        )
        for k, number in enumerate(item.ids.tolist())
    ]


class _Surface(NamedTuple):
    """Of a body: its lengths, and of each vertex the segment, place and normal in its frame; triangles."""

    offsets: Array
    owners: Array
    points: Array
    normals: Array
    triangles: Array


class BodySurfaces:
    """Surfaces of bodies; those of one person are made once, as lengths hardly change."""

    def __init__(self, shape: BodyShape):
        self._shape = shape
        self._made: dict[int, _Surface] = {}

    def place(self, body: DrawnBody) -> tuple[Array, Array, Array]:
        """Vertices (V, 3) m and normals (V, 3) in the world, and triangles (T, 3)."""
        made = self._made.get(body.id)
        if made is None or np.abs(made.offsets - body.offsets).max() > LENGTH_M:
            made = self._made[body.id] = self._make(body.offsets)
        turns = body.frames[made.owners]
        placed = body.places[made.owners] + (turns @ made.points[..., None])[..., 0]
        return placed, (turns @ made.normals[..., None])[..., 0], made.triangles

    def _make(self, offsets: Array) -> _Surface:
        owners, points, normals, triangles, count = [], [], [], [], 0
        for capsule in self._shape.capsules(offsets):
            own = capsule_mesh(capsule.begin, capsule.end, capsule.radii, capsule.wide, SIDES, RINGS)
            owners.append(np.full(len(own[0]), capsule.segment))
            points.append(own[0])
            normals.append(own[1])
            triangles.append(own[2] + count)
            count += len(own[0])
        joined = (np.concatenate(parts) for parts in (points, normals, triangles))
        return _Surface(offsets, np.concatenate(owners), *joined)


def shades(normals: Array, triangles: Array) -> Array:
    """Brightness (T,) of triangles, 0 to 1."""
    facing = (normals[triangles].mean(axis=1) @ LIGHT).clip(0.0, 1.0)
    found: Array = AMBIENT + (1.0 - AMBIENT) * facing
    return found


class ShapedBodies(NamedTuple):
    """Bodies of one instant or of a recording, by time, and their surfaces."""

    bodies: Sequence[DrawnBody]
    surfaces: BodySurfaces

    def near(self, stamp_ns: int) -> ShapedBodies:
        """Of each person the body nearest to an instant, at most `NEAR_NS` from it."""
        stamps = [body.stamp_ns for body in self.bodies]
        begin, end = bisect_left(stamps, stamp_ns - NEAR_NS), bisect_left(stamps, stamp_ns + NEAR_NS)
        found: dict[int, DrawnBody] = {}
        for body in self.bodies[begin:end]:
            other = found.get(body.id)
            if other is None or abs(body.stamp_ns - stamp_ns) < abs(other.stamp_ns - stamp_ns):
                found[body.id] = body
        return ShapedBodies(list(found.values()), self.surfaces)


def draw_bodies(
    canvas: Array, camera: Camera, shaped: ShapedBodies, colors: Sequence[Sequence[int]], scale: float
) -> None:
    """Draw bodies over a picture, what is behind first.

    Args:
        canvas: (H, W, 3) uint8, `scale` times as large as the camera's images.
        colors: blue, green, red of each body.
    """
    rows: list[tuple[Array, Array, Array]] = []
    for body, color in zip(shaped.bodies, colors):
        points, normals, triangles = shaped.surfaces.place(body)
        pixels, seen = camera.project(points)
        depths = camera.cam_from_world.apply(points)[:, 2]
        shown = ((pixels + 0.5) * scale - 0.5)[triangles]
        # those that face the camera are clockwise, as y goes down
        a, b, c = shown.swapaxes(0, 1)
        with np.errstate(invalid="ignore"):
            area = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
            good = (area < 0.0) & seen[triangles].all(1) & (np.abs(shown) < FAR).all((1, 2))
        tints = shades(normals, triangles)[:, None] * np.array(color, float)
        rows.append((shown[good], depths[triangles].mean(axis=1)[good], tints[good]))
    if not rows or not sum(len(row[0]) for row in rows):
        return
    corners, depths, tints = (np.concatenate(parts) for parts in zip(*rows))
    over, mask = canvas.copy(), np.zeros(canvas.shape[:2], np.uint8)
    fixed = np.round(corners * 2**BITS).astype(np.int32)
    for k in np.argsort(-depths, kind="stable").tolist():
        cv2.fillConvexPoly(over, fixed[k], tints[k].tolist(), cv2.LINE_8, BITS)
        cv2.fillConvexPoly(mask, fixed[k], 255, cv2.LINE_8, BITS)
    there = mask > 0
    mixed = OPACITY * over[there].astype(np.float32) + (1.0 - OPACITY) * canvas[there]
    canvas[there] = np.round(mixed).astype(np.uint8)
