"""Cones of viewing rays in which a view can vote for a joint, whatever its lens."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.voting.lanes import GAUSSIAN_END
from panoptic_ros.voting.ray_kernels import pixel_rays
from panoptic_ros.voting.scene import VoteScene

Array = np.ndarray
TILE = 4  # cells of a score map, across and down, that share a cone
RIM = np.array([[0, 0], [1, 0], [2, 0], [2, 1], [2, 2], [1, 2], [0, 2], [0, 1]]) / 2.0  # round a rectangle
BULGE = 0.25  # of the distance of two places on the rim, by which a lens bends the edge between them at most
WIDEST = 1.5  # rad, half of the angle of a cone
ROUNDING = 1e-6  # rad; and of scores


class Cones(NamedTuple):
    """Cones (N,) in the order of views and joints.

    supports: whether the view's score can be above the threshold of a view there. axes: (N, 3) in the world.
    cosines, sines: of half of the angle; the cosine is below -1 where anything may be in the cone.
    """

    views: Array
    joints: Array
    supports: Array
    axes: Array
    cosines: Array
    sines: Array


class _Rectangles(NamedTuple):
    """Pixels (N, 4), least u and w, largest u and w, outside of which scores are 0; largest scores (N,)."""

    views: Array
    joints: Array
    pixels: Array
    scores: Array


def cones_of(scene: VoteScene, view_threshold: float) -> Cones:
    """Cones that hold all places with a score above 0.

    A lens with tangential terms may show a place farther off its axis than some 80 degrees once more; such
    second images, which no real lens has, are not held.
    """
    parts = zip(_of_keypoints(scene), _of_maps(scene))
    views, joints, pixels, scores = (np.concatenate(pair) for pair in parts)
    last = np.stack([scene.cameras["width"], scene.cameras["height"]], -1)[views] - 0.5
    low, high = np.maximum(pixels[:, :2], -0.5), np.minimum(pixels[:, 2:], last)
    order = np.lexsort([joints, views])
    order = order[(low <= high).all(1)[order]]
    views, joints, low, high = views[order], joints[order], low[order], high[order]
    rays = _rays(scene.cameras, views, low[:, None] + RIM * (high - low)[:, None])
    axes = rays.sum(1)
    axes /= np.maximum(np.linalg.norm(axes, axis=-1, keepdims=True), 1e-300)
    half = _angles(rays, axes[:, None]).max(1) + BULGE * _steps(rays) + ROUNDING
    known = half < WIDEST  # not where a lens shows nothing at a part of the rim
    cosines, sines = np.where(known, np.cos(half), -2.0), np.where(known, np.sin(half), 0.0)
    return Cones(views, joints, scores[order] > view_threshold - ROUNDING, axes, cosines, sines)


def _rays(cameras: Array, views: Array, pixels: Array) -> Array:
    """Unit viewing rays (N, K, 3) in the world of pixels (N, K, 2) of views (N,); NaN where there is none."""
    rays: Array = pixel_rays(cameras, np.repeat(views, pixels.shape[1]), pixels.reshape(-1, 2))
    return rays.reshape(*pixels.shape[:2], 3)


def _angles(ones: Array, others: Array) -> Array:
    """Angles (N, K) between unit vectors (N, K, 3)."""
    angles: Array = 2.0 * np.arcsin(np.minimum(0.5 * np.linalg.norm(ones - others, axis=-1), 1.0))
    return angles


def _steps(rays: Array) -> Array:
    """The largest angles (N,) between neighbours on a rim (N, K, 3)."""
    steps: Array = _angles(rays, np.roll(rays, 1, axis=1)).max(1)
    return steps


def _of_keypoints(scene: VoteScene) -> _Rectangles:
    """Of the Gaussians of joints without maps."""
    people = scene.people
    views, joints, persons = np.nonzero((people[..., 3] > 0.0) & (scene.map_start < 0)[..., None])
    u, w, narrowness, scores = people[views, joints, persons].T
    reach = np.sqrt(GAUSSIAN_END / narrowness)
    return _Rectangles(views, joints, np.stack([u - reach, w - reach, u + reach, w + reach], -1), scores)


def _of_maps(scene: VoteScene) -> _Rectangles:
    """Of the tiles of patches that hold anything; a bilinear sample reaches one cell beyond them."""
    key = np.repeat(np.arange(len(scene.patch_start) - 1), np.diff(scene.patch_start))
    corners, sizes = scene.patch_table[:, 1:3], scene.patch_table[:, 3:5]
    across = -(-sizes // TILE)  # tiles
    mine, at = _cells(across)
    patch, place = _cells(sizes)
    cells = scene.patch_table[patch, 5] + place[:, 1] * sizes[patch, 0] + place[:, 0]
    first = np.cumsum(across.prod(1)) - across.prod(1)
    tiles = first[patch] + place[:, 1] // TILE * across[patch, 0] + place[:, 0] // TILE
    most = np.zeros(len(mine), np.uint8)
    np.maximum.at(most, tiles, scene.patch_data[cells])
    low = corners[mine] + TILE * at - 1.0
    high = np.minimum(low + TILE + 1.0, corners[mine] + sizes[mine])
    views, joints = np.divmod(key[mine], scene.map_start.shape[1])
    pixels = _pixels(scene.cameras[views], low, high)
    return _Rectangles(*(values[most > 0] for values in (views, joints, pixels, most / 255.0)))


def _cells(sizes: Array) -> tuple[Array, Array]:
    """All cells of grids of columns and rows (K, 2): which grid (C,), and column and row (C, 2) in it."""
    counts = sizes.prod(1)
    grid = np.repeat(np.arange(len(sizes)), counts)
    at = np.arange(len(grid)) - (np.cumsum(counts) - counts)[grid]
    return grid, np.stack([at % sizes[grid, 0], at // sizes[grid, 0]], -1)


def _pixels(cameras: Array, low: Array, high: Array) -> Array:
    """Rectangles (N, 4) of pixels around rectangles of cells from low (N, 2) to high (N, 2)."""
    corners = low[:, None] + RIM[::2] * (high - low)[:, None]
    a, b = corners[..., 0] - cameras["a2"][:, None], corners[..., 1] - cameras["b2"][:, None]
    a0, a1, b0, b1 = (cameras[name][:, None] for name in ("a0", "a1", "b0", "b1"))
    det = a0 * b1 - a1 * b0
    places = np.stack([(b1 * a - a1 * b) / det, (a0 * b - b0 * a) / det], -1)
    rectangles: Array = np.concatenate([places.min(1), places.max(1)], -1)
    return rectangles
