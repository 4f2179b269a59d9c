"""Distances between viewing rays."""

from __future__ import annotations

import numpy as np

Array = np.ndarray


def ray_distances(centres_a: Array, rays_a: Array, centres_b: Array, rays_b: Array) -> Array:
    """Shortest distances (...) m between lines through centres (..., 3) along rays (..., 3).

    For (nearly) parallel rays, the distance of b's centre from line a. NaN where a ray is NaN.
    """
    offset = np.asarray(centres_b) - centres_a
    normal = np.cross(rays_a, rays_b)
    length = np.linalg.norm(normal, axis=-1)
    crossing = np.abs((offset * normal).sum(-1)) / np.maximum(length, 1e-9)
    unit = rays_a / np.linalg.norm(rays_a, axis=-1, keepdims=True)
    aside = offset - (offset * unit).sum(-1, keepdims=True) * unit
    distances: Array = np.where(length < 1e-7, np.linalg.norm(aside, axis=-1), crossing)
    return distances


def closest_points(
    centres_a: Array, rays_a: Array, centres_b: Array, rays_b: Array
) -> tuple[Array, Array, Array]:
    """Where two rays come closest.

    Returns:
        points (..., 3) m midway between the lines; depths a and b (...) along each (unit) ray, m,
        negative behind the centre. Parallel rays give points far away.
    """
    offset = np.asarray(centres_b) - centres_a
    ab = (rays_a * rays_b).sum(-1)
    a_offset, b_offset = (rays_a * offset).sum(-1), (rays_b * offset).sum(-1)
    scale = 1.0 / np.maximum(1.0 - ab * ab, 1e-12)
    depth_a = (a_offset - ab * b_offset) * scale
    depth_b = (ab * a_offset - b_offset) * scale
    point_a = centres_a + depth_a[..., None] * rays_a
    point_b = centres_b + depth_b[..., None] * rays_b
    return 0.5 * (point_a + point_b), depth_a, depth_b
