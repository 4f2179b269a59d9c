"""Empty room with textured walls, as one camera sees it."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from panoptic_ros.domain import Camera, Rig

Array = np.ndarray
TEXTURE = 512  # px; side of every wall texture
PAPER = (200.0, 208.0, 212.0)  # BGR of the walls
FLOOR = (120.0, 140.0, 150.0)
CEILING = (225.0, 228.0, 230.0)
FAR = 50.0  # m; clipping limit of positions, and floor position of pixels that do not see the floor


@dataclass(frozen=True, eq=False)
class WallPlane:
    """Plane x[axis] = value with its texture (TEXTURE, TEXTURE, 3)."""

    axis: int
    value: float
    texture: Array


@dataclass(frozen=True, eq=False)
class Backdrop:
    """View of the room from one camera.

    Args:
        image: BGR image (H, W, 3) uint8.
        depth: Depth (H, W) float32 m.
        floor: Position (H, W, 2) float32 m on the floor, `FAR` where a pixel does not see the floor.
    """

    image: Array
    depth: Array
    floor: Array


@dataclass(frozen=True, eq=False)
class RenderedRoom:
    """Box-shaped room of half width `half` m and `height` m."""

    half: float
    height: float
    walls: tuple[WallPlane, ...]

    @classmethod
    def draw(cls, rng: np.random.Generator, rig: Rig) -> RenderedRoom:
        """Draw a room that contains all cameras, with noise, pictures and doors on its walls."""
        centres = np.array([camera.centre for camera in rig.cameras])
        half = max(5.4, float(np.abs(centres[:, :2]).max()) + 0.8)
        height = max(3.2, float(centres[:, 2].max()) + 0.4)
        sides = [(axis, sign * half) for axis in (0, 1) for sign in (1.0, -1.0)]
        walls = [
            WallPlane(2, 0.0, _texture(rng, FLOOR, 8.0, 0)),
            WallPlane(2, height, _texture(rng, CEILING, 3.0, 0)),
        ]
        for number, (axis, value) in enumerate(sides):
            paper = np.array(PAPER) - 8.0 * number
            walls.append(WallPlane(axis, value, _texture(rng, tuple(paper), 3.0, 3)))
        return cls(half, height, tuple(walls))

    def seen_by(self, camera: Camera, plane: Array) -> Backdrop:
        """Return the room as seen by a camera with normalised pixel coordinates `plane` (H, W, 2).

        Pixels without a ray (NaN) stay black and infinitely far.
        """
        rays = np.concatenate([plane, np.ones_like(plane[..., :1])], axis=-1)
        rays = rays @ camera.cam_from_world.rotation
        eye, shape = camera.centre, plane.shape[:2]
        image, depth = np.zeros((*shape, 3), np.float32), np.full(shape, np.inf)
        floor = np.full((*shape, 2), FAR, np.float32)
        for wall in self.walls:
            along = rays[..., wall.axis]
            t = (wall.value - eye[wall.axis]) / np.where(along == 0.0, 1e-12, along)
            seen = (t > 0.0) & (t < depth)
            points = np.clip(eye + np.where(seen, t, 0.0)[..., None] * np.nan_to_num(rays), -FAR, FAR)
            picture = cv2.remap(  # type: ignore[call-overload]  # the second map may be None
                wall.texture,
                self._texels(wall, points),
                None,
                cv2.INTER_LINEAR,
                borderMode=cv2.BORDER_REFLECT,
            )
            image[seen], depth[seen] = picture[seen], t[seen]
            floor[seen] = points[seen][:, :2] if wall.axis == 2 and wall.value == 0.0 else FAR
        pixels = np.clip(image, 0.0, 255.0).astype(np.uint8)
        return Backdrop(pixels, depth.astype(np.float32), floor)

    def _texels(self, wall: WallPlane, points: Array) -> Array:
        """Return texture coordinates (H, W, 2) of points (H, W, 3) on a wall; pictures hang upright."""
        a, b = (axis for axis in range(3) if axis != wall.axis)
        across = points[..., a] / (2.0 * self.half) + 0.5
        level = wall.axis == 2
        up = points[..., b] / (2.0 * self.half) + 0.5 if level else 1.0 - points[..., b] / self.height
        return ((TEXTURE - 1) * np.stack([across, up], axis=-1)).astype(np.float32)


def _texture(rng: np.random.Generator, colour: tuple[float, ...], contrast: float, frames: int) -> Array:
    """Draw a wall texture: cloudy, grainy paint and `frames` rectangles as pictures and doors."""
    coarse = rng.normal(0.0, 1.0, (24, 24, 1)) + rng.normal(0.0, 0.2, (24, 24, 3))
    clouds = cv2.resize(coarse, (TEXTURE, TEXTURE), interpolation=cv2.INTER_CUBIC)
    texture: Array = np.array(colour) + contrast * clouds + rng.normal(0.0, 3.0, clouds.shape)
    for left, top, width, height in rng.integers((0, 60, 25, 40), (470, 330, 90, 170), (frames, 4)).tolist():
        paint = rng.uniform(50.0, 190.0, 3).tolist()
        cv2.rectangle(texture, (left, top), (left + width, top + height), paint, -1)
    return texture.astype(np.float32)
