"""Rendered views of a take, camera by camera.

A depth buffer finds the shape that every pixel sees, by intersecting its ray with round cones. In the frame
of a cone there are spheres of radius a at the origin and b at (0, 0, length). The tangent cone has the slope
s = (a - b) / length. Its side is rho * c = a - s * z with c = sqrt(1 - s^2), between z = a * s and z = length
+ b * s. With p = o + t * d this is a quadratic in t; outside that range the ray can only hit the spheres.
Rays have z = 1 in the camera frame, so t is the depth in metres in every frame. `cast_rays` is compiled,
which reduces its time from 0.5 s to some 5 ms per VGA view.

Soft shadows of people are drawn into a map of the floor, seen from above.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import cv2
import numpy as np

from panoptic_ros.domain import Camera, Rig
from panoptic_ros.kernels import njit
from panoptic_ros.simulation.people import SimulatedPerson
from panoptic_ros.simulation.rendering.figure import figure
from panoptic_ros.simulation.rendering.paint import LIGHT, paint_pixels
from panoptic_ros.simulation.rendering.room import RenderedRoom
from panoptic_ros.simulation.rendering.shapes import Material, Shapes
from panoptic_ros.simulation.rendering.wardrobe import Appearance
from panoptic_ros.simulation.skeleton import SKELETON, J

CELLS = 256
KEY, CONTACT = 0.80, 0.62  # brightness factors in the cast shadow, and directly under people
SOFT_KEY, SOFT_CONTACT = 1.5, 2.2  # cells; standard deviations of the blur of both shadows
_BONES = [(a, b) for a, b in SKELETON.bones if J["lEye"] not in (a, b) and J["rEye"] not in (a, b)]
NEAR = 0.2  # m; nothing closer is drawn
HAIR = int(Material.HAIR)
NOTHING = -1
# bounds of the parts cut away from the hair's ellipsoid: the face and the neck
FACE_FROM, FACE_TOP, FACE_SLOPE, NECK_BELOW = 0.38, 0.62, 0.30, -0.45
Array = np.ndarray
NOISE = 1.5  # grey levels; standard deviation of the sensor noise
TILE = 64  # px; range of the random shift of the noise pattern
OPTICS = 0.6  # px; standard deviation of the optical blur
CHUNK = 32  # number of instants whose shapes are built at once


class FloorShadow:
    """Shadow map of a square floor of 2 * `half` m around the origin, in CELLS x CELLS cells."""

    def __init__(self, half: float):
        self._scale, self._half = (CELLS - 1) / (2.0 * half), half

    def cells(self, places: Array) -> Array:
        """Return cell coordinates (..., 2) of floor positions (..., 2) m."""
        return (places + self._half) * self._scale

    def shade(self, joints: Array) -> Array:
        """Return the brightness (CELLS, CELLS) float32 of the floor under people with joints (P, 19, 3) m."""
        key, contact = np.ones((CELLS, CELLS), np.float32), np.ones((CELLS, CELLS), np.float32)
        thrown = joints[..., :2] - joints[..., 2:] * (LIGHT[:2] / LIGHT[2])
        for place, points in zip(thrown, joints):
            cells = np.rint(self.cells(place)).astype(int).tolist()
            for a, b in _BONES:
                cv2.line(key, cells[a], cells[b], KEY, self._cells(0.14))
            below = np.rint(self.cells(points[..., :2])).astype(int).tolist()
            for name, radius in (("lAnkle", 0.13), ("rAnkle", 0.13), ("BodyCenter", 0.20)):
                cv2.circle(contact, below[J[name]], self._cells(radius), CONTACT, -1)
        soft = cv2.GaussianBlur(key, (0, 0), SOFT_KEY)
        return soft * cv2.GaussianBlur(contact, (0, 0), SOFT_CONTACT)

    def _cells(self, metres: float) -> int:
        return max(1, round(metres * self._scale))


@njit(cache=True)
def cast_rays(
    frames: Array,
    origins: Array,
    lengths: Array,
    radii: Array,
    materials: Array,
    boxes: Array,
    plane: Array,
    depth: Array,
    hits: Array,
) -> None:
    """Fill `depth` and `hits` with the nearest shapes, in place.

    Args:
        frames: Rotations (N, 3, 3), local_from_camera, including the squash.
        origins: Camera centre (N, 3) m in the local frames.
        lengths, radii, materials: Arrays (N,), (N, 2), (N,), see `Shapes`.
        boxes: Columns and rows (N, 4) int (from, from, to, to) that the shape may cover.
        plane: Normalised coordinates (H, W, 2) of the pixels' rays.
        depth: Depth (H, W) float32 m, initialised with the background.
        hits: Index (H, W) int16 of the nearest shape.
    """
    for n in range(len(lengths)):
        m, o, length, a, b = frames[n], origins[n], lengths[n], radii[n, 0], radii[n, 1]
        s = (a - b) / length
        coned = abs(s) < 1.0
        c2 = 1.0 - s * s
        rest = a - s * o[2]
        low, high = a * s, length + b * s
        sphere_a = o[0] * o[0] + o[1] * o[1] + o[2] * o[2] - a * a
        o2 = o[2] - length
        sphere_b = o[0] * o[0] + o[1] * o[1] + o2 * o2 - b * b
        for v in range(boxes[n, 1], boxes[n, 3]):
            for u in range(boxes[n, 0], boxes[n, 2]):
                x, y = plane[v, u, 0], plane[v, u, 1]
                dx = m[0, 0] * x + m[0, 1] * y + m[0, 2]
                dy = m[1, 0] * x + m[1, 1] * y + m[1, 2]
                dz = m[2, 0] * x + m[2, 1] * y + m[2, 2]
                t = math.inf
                if coned:
                    qa = (dx * dx + dy * dy) * c2 - s * s * dz * dz
                    qb = (o[0] * dx + o[1] * dy) * c2 + s * dz * rest
                    qc = (o[0] * o[0] + o[1] * o[1]) * c2 - rest * rest
                    root = qb * qb - qa * qc
                    if root >= 0.0 and abs(qa) > 1e-12:
                        side = (-qb - math.sqrt(root)) / qa
                        z = o[2] + side * dz
                        if low < z < high:
                            t = side
                if t == math.inf:
                    dd = dx * dx + dy * dy + dz * dz
                    half = o[0] * dx + o[1] * dy
                    ha, hb = half + o[2] * dz, half + o2 * dz
                    root = ha * ha - dd * sphere_a
                    if root > 0.0:
                        t = (-ha - math.sqrt(root)) / dd
                    root = hb * hb - dd * sphere_b
                    if root > 0.0:
                        t = min(t, (-hb - math.sqrt(root)) / dd)
                if not (NEAR < t < depth[v, u]):
                    continue
                if materials[n] == HAIR:
                    px, py, pz = (o[0] + t * dx) / a, abs(o[1] + t * dy) / a, (o[2] + t * dz) / a
                    if (px > FACE_FROM and pz < FACE_TOP - FACE_SLOPE * py) or pz < NECK_BELOW:
                        continue
                depth[v, u] = t
                hits[v, u] = n


@dataclass(frozen=True, eq=False)
class RenderedView:
    """One rendered image.

    Args:
        image: BGR image (H, W, 3) uint8.
        depth: Depth (H, W) float32 m along the optical axis.
        people: Person map (H, W) uint8, 0 = room, k + 1 = the k-th person of the take.
    """

    image: Array
    depth: Array
    people: Array


class RenderedTake(Protocol):
    """Take that can be rendered: `Simulation` or `FreeRunningCapture`."""

    @property
    def seed(self) -> tuple[int, ...]:
        """Return the root seed of all random numbers."""
        ...

    @property
    def rig(self) -> Rig:
        """Return the cameras."""
        ...

    @property
    def people(self) -> tuple[SimulatedPerson, ...]:
        """Return the true people."""
        ...


class Studio:
    """Room and appearances of a take, shared by all of its cameras."""

    def __init__(self, take: RenderedTake):
        self.take = take
        self.room = RenderedRoom.draw(np.random.default_rng([*take.seed, 5]), take.rig)
        rng = np.random.default_rng([*take.seed, 6])
        self.looks = [Appearance.draw(rng) for _ in take.people]
        self.floor = FloorShadow(self.room.half)

    def camera(self, name: str) -> CameraRenderer:
        """Return the renderer of one camera."""
        return CameraRenderer(self, self.take.rig.index(name))


class CameraRenderer:
    """Renderer of one camera's views at any instant."""

    def __init__(self, studio: Studio, index: int):
        self._studio, self._index = studio, index
        self.camera = studio.take.rig.cameras[index]
        self._plane = pixel_plane(self.camera)
        backdrop = studio.room.seen_by(self.camera, self._plane)
        self._backdrop = backdrop
        self._floor_cells = studio.floor.cells(backdrop.floor).astype(np.float32)
        rng = np.random.default_rng([*studio.take.seed, 7, index])
        width, height = self.camera.image_size
        noise = rng.normal(0.0, NOISE, (height + TILE, width + TILE, 3))
        self._noise = np.rint(noise).astype(np.int16)

    def render(self, times: Array) -> Iterator[RenderedView]:
        """Yield the views at `times` (T,) s in order."""
        for first in range(0, len(times), CHUNK):
            part = np.asarray(times[first : first + CHUNK], np.float64)
            present = np.stack([person.is_present(part) for person in self._studio.take.people])
            shapes, joints = self._shapes(part)
            for t, time in enumerate(part):
                yield self._view(shapes, t, present[:, t], joints[present[:, t], t], float(time))

    def _shapes(self, times: Array) -> tuple[Shapes, Array]:
        """Return the shapes of all people and their joints (P, T, 19, 3) m at times (T,) s."""
        people = self._studio.take.people
        postures = [person.posture(times) for person in people]
        figures = [
            figure(person.body, posture, look, number)
            for number, (person, posture, look) in enumerate(zip(people, postures, self._studio.looks))
        ]
        return Shapes.join(figures), np.stack([posture.joints for posture in postures])

    def _view(self, shapes: Shapes, t: int, present: Array, joints: Array, time: float) -> RenderedView:
        depth, hits = self._cast(shapes, t, present)
        shade = cv2.remap(  # type: ignore[call-overload]  # the second map may be None
            self._studio.floor.shade(joints),
            self._floor_cells,
            None,
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_CONSTANT,
            borderValue=1.0,
        )
        image = cv2.multiply(self._backdrop.image, cv2.merge([shade] * 3), dtype=cv2.CV_8U)
        people = np.zeros(hits.shape, np.uint8)
        pose = self.camera.cam_from_world
        paint_pixels(
            shapes.local_from_world[t],
            shapes.origins[t],
            shapes.lengths[t],
            shapes.radii,
            shapes.materials,
            shapes.seeds,
            shapes.colours,
            shapes.people,
            self.camera.centre,
            np.ascontiguousarray(pose.rotation.T),
            self._plane,
            depth,
            hits,
            image,
            people,
        )
        return RenderedView(self._develop(image, time), depth, people)

    def _cast(self, shapes: Shapes, t: int, present: Array) -> tuple[Array, Array]:
        """Return the depth and the shape index (H, W) of every pixel."""
        boxes = shape_boxes(self.camera, shapes, t)
        boxes[~present[shapes.people]] = 0
        depth = self._backdrop.depth.copy()
        hits = np.full(depth.shape, NOTHING, np.int16)
        self._cast_into(shapes, t, boxes, depth, hits)
        return depth, hits

    def _cast_into(self, shapes: Shapes, t: int, boxes: Array, depth: Array, hits: Array) -> None:
        frames = shapes.local_from_world[t]
        eye = (frames @ (self.camera.centre - shapes.origins[t])[..., None])[..., 0]
        frames = np.ascontiguousarray(frames @ self.camera.cam_from_world.rotation.T)
        cast_rays(
            frames, eye, shapes.lengths[t], shapes.radii, shapes.materials, boxes, self._plane, depth, hits
        )

    def _develop(self, image: Array, time: float) -> Array:
        """Return the image with optical blur and sensor noise, which differs at every instant."""
        image = cv2.GaussianBlur(image, (3, 3), OPTICS)
        moment = np.random.default_rng([self._index, round(abs(time) * 1e6)])
        x, y = moment.integers(TILE, size=2)
        height, width = image.shape[:2]
        return cv2.add(image, self._noise[y : y + height, x : x + width], dtype=cv2.CV_8U)


def pixel_plane(camera: Camera) -> Array:
    """Return normalised, undistorted coordinates (H, W, 2) of all pixels."""
    width, height = camera.image_size
    pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1)
    return camera.intrinsics.undistort(pixels.astype(np.float64))


def shape_boxes(camera: Camera, shapes: Shapes, t: int) -> Array:
    """Return columns and rows (N, 4) int (from, from, to, to) that each shape may cover."""
    axes = np.linalg.inv(shapes.local_from_world[t])[..., 2] * shapes.lengths[t][:, None]
    ends = np.stack([shapes.origins[t], shapes.origins[t] + axes], axis=1)  # (N, 2, 3)
    local = camera.cam_from_world.apply(ends)
    depth = local[..., 2] - shapes.bounds[:, None]
    seen = (depth > NEAR).all(1)
    safe = np.maximum(local[..., 2], NEAR)
    middle = local[..., :2] / safe[..., None]
    margin = 1.05 * shapes.bounds[:, None] / np.maximum(depth, NEAR)
    steps = np.array([[-1, -1], [-1, 0], [-1, 1], [0, -1], [0, 1], [1, -1], [1, 0], [1, 1]], float)
    rim = (
        middle[:, :, None]
        + margin[..., None, None] * np.sqrt(1.0 + (middle**2).sum(-1))[..., None, None] * steps
    )
    limit = 0.98 * min(camera.intrinsics.radius_limit, 1e3)
    radius = np.linalg.norm(rim, axis=-1, keepdims=True)
    rim = rim * np.minimum(1.0, limit / np.maximum(radius, 1e-9))
    pixels = camera.intrinsics.pixels_from_plane(camera.intrinsics.distort(rim)).reshape(len(seen), -1, 2)
    low, high = np.floor(pixels.min(1)) - 1.0, np.ceil(pixels.max(1)) + 2.0
    size = np.array(camera.image_size, np.float64)
    boxes = np.concatenate([np.clip(low, 0.0, size), np.clip(high, 0.0, size)], axis=-1).astype(np.int64)
    boxes[~seen] = 0
    return boxes
