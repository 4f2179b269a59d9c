"""Views of a take, camera by camera."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np

from panoptic_ros.domain import Camera
from panoptic_ros.simulation.rendering.figure import figure
from panoptic_ros.simulation.rendering.paint import paint_pixels
from panoptic_ros.simulation.rendering.raycast import NEAR, NOTHING, cast_rays
from panoptic_ros.simulation.rendering.room import Room
from panoptic_ros.simulation.rendering.shadows import Floor
from panoptic_ros.simulation.rendering.shapes import Shapes
from panoptic_ros.simulation.rendering.wardrobe import Appearance
from panoptic_ros.simulation.simulate import Simulation

Array = np.ndarray
NOISE = 1.5  # standard deviation of the sensor's noise, grey levels
TILE = 64  # px by which the noise pattern can shift
OPTICS = 0.6  # px, blur
CHUNK = 32  # instants whose shapes are made at once


@dataclass(frozen=True, eq=False)
class RenderedView:
    """One image.

    Args:
        image: (H, W, 3) uint8 BGR.
        depth: (H, W) float32 m along the optical axis.
        people: (H, W) uint8, 0 = room, k + 1 = the k-th person of the take.
    """

    image: Array
    depth: Array
    people: Array


class Studio:
    """Room and clothes of a take: what all of its cameras see."""

    def __init__(self, take: Simulation):
        self.take = take
        self.room = Room.draw(np.random.default_rng([*take.seed, 5]), take.rig)
        rng = np.random.default_rng([*take.seed, 6])
        self.looks = [Appearance.draw(rng) for _ in take.people]
        self.floor = Floor(self.room.half)

    def camera(self, name: str) -> CameraRenderer:
        """The renderer of one camera."""
        return CameraRenderer(self, self.take.rig.index(name))


class CameraRenderer:
    """Renders what one camera sees at any instant."""

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
        """Views at `times` (T,) s, one after another."""
        for first in range(0, len(times), CHUNK):
            part = np.asarray(times[first : first + CHUNK], np.float64)
            present = np.stack([person.is_present(part) for person in self._studio.take.people])
            shapes, joints = self._shapes(part)
            for t, time in enumerate(part):
                yield self._view(shapes, t, present[:, t], joints[present[:, t], t], float(time))

    def _shapes(self, times: Array) -> tuple[Shapes, Array]:
        """Everybody's shapes, and joints (P, T, 19, 3) m, at times (T,) s."""
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
        """Depth and index of the shape (H, W) of every pixel."""
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
        """Blur of the optics and noise of the sensor, another one at every instant."""
        image = cv2.GaussianBlur(image, (3, 3), OPTICS)
        moment = np.random.default_rng([self._index, round(abs(time) * 1e6)])
        x, y = moment.integers(TILE, size=2)
        height, width = image.shape[:2]
        return cv2.add(image, self._noise[y : y + height, x : x + width], dtype=cv2.CV_8U)


def pixel_plane(camera: Camera) -> Array:
    """Normalised, undistorted coordinates (H, W, 2) of all pixels."""
    width, height = camera.image_size
    pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1)
    return camera.intrinsics.undistort(pixels.astype(np.float64))


def shape_boxes(camera: Camera, shapes: Shapes, t: int) -> Array:
    """Columns and rows (N, 4) int (from, from, to, to) that each shape may cover."""
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
