"""Colours of the pixels that show a person: material, folds, face and light.

`paint_pixels` is compiled, which reduces its time from 10 ms to 1 ms per VGA view.
"""

from __future__ import annotations

import math

import numpy as np

from panoptic_ros.kernels import njit
from panoptic_ros.simulation.rendering.shapes import Material

Array = np.ndarray
# unit vector towards the light, world frame
LIGHT = np.array([0.45, -0.35, 0.82]) / np.linalg.norm([0.45, -0.35, 0.82])
AMBIENT, SKY, KEY = 0.50, 0.18, 0.42
CLOTH, STRIPES, FACE = int(Material.CLOTH), int(Material.STRIPES), int(Material.FACE)
STRIPES_PER_M, STRIPE_GAIN = 28.0, 0.55
# face of radius 1: side and height of the eyes, height of the brows above the eyes, height of the mouth
EYE_SIDE, EYE_HEIGHT, BROW_ABOVE, MOUTH = 0.42, 0.02, 0.20, -0.52
FRONT = 0.3  # forward coordinate on a face of radius 1; only points in front of it are painted


@njit(cache=True)
def paint_pixels(
    frames: Array,
    origins: Array,
    lengths: Array,
    radii: Array,
    materials: Array,
    seeds: Array,
    colours: Array,
    people: Array,
    eye: Array,
    world_from_camera: Array,
    plane: Array,
    depth: Array,
    hits: Array,
    image: Array,
    ids: Array,
) -> None:
    """Colour all pixels that hit a shape and mark their person, in place.

    Args:
        frames: Transforms (N, 3, 3), local_from_world.
        origins: Origins (N, 3) m, world.
        lengths, radii, materials, seeds, colours, people: See `Shapes`.
        eye: Camera centre (3,) m.
        world_from_camera: Rotation (3, 3).
        plane, depth, hits: See `cast_rays`.
        image: Image (H, W, 3) uint8.
        ids: Person index + 1, (H, W) uint8.
    """
    height, width = depth.shape
    local, normal = np.empty(3), np.empty(3)
    point, away = np.empty(3), np.empty(3)
    for v in range(height):
        for u in range(width):
            n = hits[v, u]
            if n < 0:
                continue
            x, y, z = plane[v, u, 0], plane[v, u, 1], depth[v, u]
            for i in range(3):
                w = world_from_camera[i]
                point[i] = eye[i] + z * (w[0] * x + w[1] * y + w[2]) - origins[n, i]
            for i in range(3):
                f = frames[n, i]
                local[i] = f[0] * point[0] + f[1] * point[1] + f[2] * point[2]
            slope = min(max((radii[n, 0] - radii[n, 1]) / lengths[n], -1.0), 1.0)
            tangent = slope / math.sqrt(max(1.0 - slope * slope, 1e-6))
            rho = math.sqrt(local[0] * local[0] + local[1] * local[1])
            normal[0], normal[1] = local[0], local[1]
            normal[2] = local[2] - min(max(local[2] - rho * tangent, 0.0), lengths[n])
            for i in range(3):
                away[i] = frames[n, 0, i] * normal[0] + frames[n, 1, i] * normal[1]
                away[i] += frames[n, 2, i] * normal[2]
            size = math.sqrt(away[0] * away[0] + away[1] * away[1] + away[2] * away[2])
            facing = (away[0] * LIGHT[0] + away[1] * LIGHT[1] + away[2] * LIGHT[2]) / size
            gain = AMBIENT + SKY * away[2] / size + KEY * max(facing, 0.0)
            if materials[n] == CLOTH or materials[n] == STRIPES:
                wave = math.sin(42.0 * local[2] + 9.0 * math.sin(19.0 * local[0] + seeds[n]))
                gain *= 1.0 + 0.10 * wave * math.sin(27.0 * local[1] + seeds[n])
            if materials[n] == STRIPES and math.floor(STRIPES_PER_M * local[2]) % 2 == 0:
                gain *= STRIPE_GAIN
            if materials[n] == FACE:
                a = radii[n, 0]
                gain *= _face_gain(local[0] / a, abs(local[1]) / a, local[2] / a)
            for i in range(3):
                image[v, u, i] = np.uint8(min(max(colours[n, i] * gain, 0.0), 255.0))
            ids[v, u] = people[n] + 1


@njit(cache=True)
def _face_gain(x: float, y: float, z: float) -> float:
    """Return the brightness factor at a point of the face; y is the distance from the face's middle plane."""
    if x <= FRONT:
        return 1.0
    eye = 4.0 * (y - EYE_SIDE) ** 2 + 14.0 * (z - EYE_HEIGHT) ** 2
    if eye < 0.06:
        return 0.18 if abs(y - EYE_SIDE) < 0.1 else 1.35
    if eye < 0.10:
        return 0.85
    brow = abs(z - EYE_HEIGHT - BROW_ABOVE) < 0.045 and abs(y - EYE_SIDE) < 0.2
    mouth = abs(z - MOUTH) < 0.06 and y < 0.3
    return 0.45 if brow or mouth else 1.0
