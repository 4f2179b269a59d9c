"""Shaded surface meshes of body segments, drawn into images and 3D plots."""

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
SIDES, RINGS = 10, 2  # facets around and rings along each capsule mesh
OPACITY = 0.7  # weight of the rendered body when blended over an image
# unit vector towards the light, world frame
LIGHT = np.array([0.35, 0.25, 0.9]) / np.linalg.norm([0.35, 0.25, 0.9])
AMBIENT = 0.45  # ambient share of the brightness, 0 to 1
FAR = 1e5  # px; triangles with a corner beyond this are not drawn
BITS = 4  # fractional bits of OpenCV's fixed-point pixel coordinates
NEAR_NS = 50_000_000  # ns; largest time difference between a body state and the image that it is drawn into
LENGTH_M = 0.002  # m; a cached surface is rebuilt when a segment length changes by more than this


class DrawnBody(NamedTuple):
    """Pose and segment lengths of one body at one instant.

    Args:
        stamp_ns: Time of the state.
        id: Track id.
        places: Segment origins (S, 3) m, world.
        frames: Rotations (S, 3, 3), world from segment.
        offsets: Segment offsets (S, 3) m, which set the body's lengths.
    """

    stamp_ns: int
    id: int
    places: Array
    frames: Array
    offsets: Array


def drawn_bodies(item: BodyStateSet) -> list[DrawnBody]:
    """Return the drawable bodies of one body state set."""
    return [
        DrawnBody(
            item.stamp_ns, number, item.positions[k], from_quaternions(item.orientations[k]), item.offsets[k]
        )
        for k, number in enumerate(item.ids.tolist())
    ]


class _Surface(NamedTuple):
    """Triangle mesh of one body, with vertices in segment frames.

    Args:
        offsets: Segment offsets (S, 3) m that the mesh was built for.
        owners: Segment index (V,) of each vertex.
        points: Vertices (V, 3) m, segment frame.
        normals: Unit normals (V, 3), segment frame.
        triangles: Vertex indices (T, 3).
    """

    offsets: Array
    owners: Array
    points: Array
    normals: Array
    triangles: Array


class BodySurfaces:
    """Surface meshes of bodies, cached per person because segment lengths hardly change."""

    def __init__(self, shape: BodyShape):
        self._shape = shape
        self._made: dict[int, _Surface] = {}

    def place(self, body: DrawnBody) -> tuple[Array, Array, Array]:
        """Return vertices (V, 3) m and normals (V, 3) in the world frame, and triangles (T, 3)."""
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
    """Return the brightness (T,) of triangles, 0 to 1."""
    facing = (normals[triangles].mean(axis=1) @ LIGHT).clip(0.0, 1.0)
    found: Array = AMBIENT + (1.0 - AMBIENT) * facing
    return found


class ShapedBodies(NamedTuple):
    """Bodies of one instant or of a whole recording, sorted by time, with their surface cache."""

    bodies: Sequence[DrawnBody]
    surfaces: BodySurfaces

    def near(self, stamp_ns: int) -> ShapedBodies:
        """Return the body nearest in time to `stamp_ns` for each person, within `NEAR_NS`."""
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
    """Draw bodies into an image, far triangles first.

    Args:
        canvas: Image (H, W, 3) uint8, `scale` times as large as the camera's images. It is modified in place.
        colors: BGR colour of each body.
    """
    rows: list[tuple[Array, Array, Array]] = []
    for body, color in zip(shaped.bodies, colors):
        points, normals, triangles = shaped.surfaces.place(body)
        pixels, seen = camera.project(points)
        depths = camera.cam_from_world.apply(points)[:, 2]
        shown = ((pixels + 0.5) * scale - 0.5)[triangles]
        # front faces have negative signed area, because the image y axis points down
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
