"""What the kernels of rendering do, in numpy."""

from __future__ import annotations

import numpy as np

from panoptic_ros.simulation.rendering.paint import (
    AMBIENT,
    BROW_ABOVE,
    CLOTH,
    EYE_HEIGHT,
    EYE_SIDE,
    FACE,
    FRONT,
    KEY,
    LIGHT,
    MOUTH,
    SKY,
    STRIPE_GAIN,
    STRIPES,
    STRIPES_PER_M,
)
from panoptic_ros.simulation.rendering.renderer import FACE_FROM, FACE_SLOPE, FACE_TOP, HAIR, NEAR, NECK_BELOW

Array = np.ndarray


def paint_reference(
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
    """As `paint_pixels`, in numpy."""
    rows, columns = np.nonzero(hits >= 0)
    n = hits[rows, columns]
    rays = np.column_stack([plane[rows, columns], np.ones(len(n))]) @ world_from_camera.T
    points = eye + depth[rows, columns, None] * rays
    local = (frames[n] @ (points - origins[n])[..., None])[..., 0]
    normals = _normals(local, radii[n], lengths[n])
    away = (frames[n].swapaxes(-1, -2) @ normals[..., None])[..., 0]
    away /= np.linalg.norm(away, axis=-1, keepdims=True)
    gain = AMBIENT + SKY * away[:, 2] + KEY * np.maximum(away @ LIGHT, 0.0)
    x, y, z = local.T
    folds = np.sin(42.0 * z + 9.0 * np.sin(19.0 * x + seeds[n])) * np.sin(27.0 * y + seeds[n])
    kind = materials[n]
    gain *= np.where((kind == CLOTH) | (kind == STRIPES), 1.0 + 0.10 * folds, 1.0)
    gain *= np.where((kind == STRIPES) & (np.floor(STRIPES_PER_M * z) % 2 == 0), STRIPE_GAIN, 1.0)
    gain *= np.where(kind == FACE, _face_reference(local / radii[n, :1]), 1.0)
    image[rows, columns] = np.clip(colours[n] * gain[:, None], 0.0, 255.0).astype(np.uint8)
    ids[rows, columns] = people[n] + 1


def _normals(local: Array, radii: Array, lengths: Array) -> Array:
    """Directions (M, 3) away from the surface at points (M, 3), in the local frames, not normalised."""
    slope = np.clip((radii[:, 0] - radii[:, 1]) / lengths, -1.0, 1.0)
    tangent = slope / np.sqrt(np.maximum(1.0 - slope * slope, 1e-6))
    rho = np.linalg.norm(local[:, :2], axis=-1)
    foot = np.clip(local[:, 2] - rho * tangent, 0.0, lengths)  # where the normal starts on the axis
    normals: Array = local - np.stack([np.zeros_like(foot), np.zeros_like(foot), foot], axis=-1)
    return normals


def _face_reference(unit: Array) -> Array:
    x, y, z = unit[:, 0], np.abs(unit[:, 1]), unit[:, 2]
    eye = 4.0 * (y - EYE_SIDE) ** 2 + 14.0 * (z - EYE_HEIGHT) ** 2
    brow = (np.abs(z - EYE_HEIGHT - BROW_ABOVE) < 0.045) & (np.abs(y - EYE_SIDE) < 0.2)
    mouth = (np.abs(z - MOUTH) < 0.06) & (y < 0.3)
    gain = np.where(brow | mouth, 0.45, 1.0)
    gain = np.where(eye < 0.10, 0.85, gain)
    gain = np.where(eye < 0.06, np.where(np.abs(y - EYE_SIDE) < 0.1, 0.18, 1.35), gain)
    return np.where(x > FRONT, gain, 1.0)


def cast_rays_reference(
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
    """As `cast_rays`, in numpy; boxes are not used."""
    with np.errstate(invalid="ignore", divide="ignore"):
        for n in range(len(lengths)):
            direction = plane @ frames[n][:, :2].T + frames[n][:, 2]
            t = _nearest_hit(origins[n], direction, float(lengths[n]), *radii[n])
            p = (origins[n] + t[..., None] * direction) / radii[n, 0]
            face = (p[..., 0] > FACE_FROM) & (p[..., 2] < FACE_TOP - FACE_SLOPE * np.abs(p[..., 1]))
            cut = (materials[n] == HAIR) & (face | (p[..., 2] < NECK_BELOW))
            nearer = (t > NEAR) & (t < depth) & ~cut
            depth[nearer], hits[nearer] = t[nearer], n


def _nearest_hit(o: Array, d: Array, length: float, a: float, b: float) -> Array:
    """Depth (H, W) of the first hit of rays o + t * d, inf where there is none."""
    spheres = [_sphere_hit(o - [0.0, 0.0, z], d, r) for z, r in ((0.0, a), (length, b))]
    nearest: Array = np.minimum(*spheres)
    s = (a - b) / length
    if abs(s) >= 1.0:
        return nearest
    c2, rest = 1.0 - s * s, a - s * o[2]
    qa = (d[..., 0] ** 2 + d[..., 1] ** 2) * c2 - (s * d[..., 2]) ** 2
    qb = (o[0] * d[..., 0] + o[1] * d[..., 1]) * c2 + s * d[..., 2] * rest
    qc = (o[0] ** 2 + o[1] ** 2) * c2 - rest**2
    side = (-qb - np.sqrt(qb * qb - qa * qc)) / qa
    z = o[2] + side * d[..., 2]
    on_side = (z > a * s) & (z < length + b * s) & (np.abs(qa) > 1e-12)
    depths: Array = np.where(on_side, side, nearest)
    return depths


def _sphere_hit(o: Array, d: Array, radius: float) -> Array:
    half, dd = d @ o, (d * d).sum(-1)
    root = half * half - dd * (o @ o - radius * radius)
    return np.where(root > 0.0, (-half - np.sqrt(np.maximum(root, 0.0))) / dd, np.inf)
