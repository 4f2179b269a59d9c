"""How well the rays of people meet, camera pair by camera pair, without any solver.

For two cameras, people are matched one to one so that the rays of their joints miss each other as
little as possible. The residual of a joint is the pixel error that both views would have to share
for its rays to meet: e = d / (z_a / f_a + z_b / f_b), with the rays' distance d and the depths z. It does
not depend on the unit of length, and is `BEHIND` where the rays meet behind a camera.
"""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from panoptic_ros.domain import Camera, Rig, ViewDetections
from panoptic_ros.geometry import Intrinsics
from panoptic_ros.kernels.assignment import best_assignment

Array = np.ndarray
BEHIND = 1e4  # px
LEAST_SCORE = 0.2  # of a joint that is used
LEAST_JOINTS = 5  # of a person that is used
LEAST_ANGLE = 0.1  # rad between two rays; flatter ones say nothing about each other's depth
ALL_PAIRS = 10  # cameras; with more, each is compared with NEIGHBOURS others, evenly spread
NEIGHBOURS = 6


@dataclass(frozen=True, slots=True, eq=False)
class Met:
    """People matched between two cameras, over all instants.

    Args:
        pixels: (M,) median over the joints of the residual, px.
        metres: (M,) median distance of the rays, in the unit of the rig.
        points: (M, J, 3) midway between the rays, NaN where a joint is missing.
    """

    pixels: Array
    metres: Array
    points: Array


def camera_pairs(rig: Rig) -> list[tuple[int, int]]:
    """The pairs (a, b), a < b, that are compared."""
    count = len(rig)
    if count <= ALL_PAIRS:
        return [(a, b) for a in range(count) for b in range(a + 1, count)]
    steps = {max(1, round(count * k / (NEIGHBOURS + 1))) for k in range(1, NEIGHBOURS + 1)}
    others = [(a, (a + step) % count) for a in range(count) for step in steps]
    return sorted({(min(a, b), max(a, b)) for a, b in others if a != b})


class RayCache:
    """Undistorted points of views, so that trying other poses does not undistort again."""

    def __init__(self) -> None:
        self._rays: dict[tuple[Intrinsics, ViewDetections], Array] = {}

    def rays(self, camera: Camera, views: Sequence[ViewDetections]) -> Array:
        """Unit rays (F, P, J, 3) in the world for F views, NaN where there is no joint of good score."""
        each = [self._in_camera(camera.intrinsics, view) for view in views]
        people = max(len(rays) for rays in each)
        stack = np.full((len(each), people, *each[0].shape[1:]), np.nan)
        for row, rays in zip(stack, each):
            row[: len(rays)] = rays
        rotated: Array = stack @ camera.cam_from_world.rotation
        return rotated

    def _in_camera(self, intrinsics: Intrinsics, view: ViewDetections) -> Array:
        key = intrinsics, view
        if key not in self._rays:
            plane = np.where((view.scores >= LEAST_SCORE)[..., None], view.points, np.nan)
            plane = intrinsics.undistort(plane)
            rays = np.concatenate([plane, np.ones_like(plane[..., :1])], axis=-1)
            self._rays[key] = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
        return self._rays[key]


def meet(
    camera_a: Camera,
    camera_b: Camera,
    views: Sequence[tuple[ViewDetections, ViewDetections]],
    cache: RayCache,
) -> Met:
    """The people that two cameras saw at the same instants, matched one to one."""
    if not views:
        return Met(np.zeros(0), np.zeros(0), np.zeros((0, 0, 3)))
    rays_a = cache.rays(camera_a, [a for a, _ in views])[:, :, None]
    rays_b = cache.rays(camera_b, [b for _, b in views])[:, None]
    offset = camera_b.centre - camera_a.centre
    cosine = np.einsum("fpqji,fpqji->fpqj", *np.broadcast_arrays(rays_a, rays_b))
    sine2 = 1.0 - cosine**2
    along_a, along_b = rays_a @ offset, rays_b @ offset
    with np.errstate(divide="ignore", invalid="ignore"):
        depth_a = (along_a - cosine * along_b) / sine2
        depth_b = (cosine * along_a - along_b) / sine2
    gap = offset + depth_b[..., None] * rays_b - depth_a[..., None] * rays_a
    distance = np.sqrt((gap * gap).sum(-1))
    pixels = distance / (np.abs(depth_a) / _focal(camera_a) + np.abs(depth_b) / _focal(camera_b))
    pixels = np.where((depth_a > 0.0) & (depth_b > 0.0), pixels, BEHIND)
    known = sine2 > LEAST_ANGLE**2  # False where a joint is missing
    enough = known.sum(-1) >= LEAST_JOINTS
    residual = _median(pixels, known, enough)
    at = _matches(residual, enough)
    halfway = camera_a.centre + depth_a[at][..., None] * rays_a[at[0], at[1], 0] + 0.5 * gap[at]
    points = np.where(known[at][..., None], halfway, np.nan)
    return Met(residual[at], _median(distance, known, enough)[at], points)


def _matches(residual: Array, enough: Array) -> tuple[Array, Array, Array]:
    """Indices (instant, person of a, person of b) of the best matching of each instant."""
    found = []
    for instant, (costs, allowed) in enumerate(zip(residual, enough)):
        rows, columns = best_assignment(np.where(allowed, np.minimum(costs, BEHIND), 2 * BEHIND))
        found += [(instant, a, b) for a, b in zip(rows, columns) if allowed[a, b]]
    table = np.array(found, dtype=int).reshape(-1, 3)
    return table[:, 0], table[:, 1], table[:, 2]


def _median(values: Array, known: Array, enough: Array) -> Array:
    """Lower median (P, Q) of the known values (P, Q, J); inf where there are not enough."""
    ordered = np.sort(np.where(known, values, np.inf), axis=-1)
    middle = np.maximum((known.sum(-1) - 1) // 2, 0)
    median = np.take_along_axis(ordered, middle[..., None], axis=-1)[..., 0]
    return np.where(enough, median, np.inf)


def _focal(camera: Camera) -> float:
    return float(0.5 * np.trace(camera.intrinsics.matrix[:2, :2]))
