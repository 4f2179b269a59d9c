"""How well the rays of people meet, camera pair by camera pair, without any solver.

For two cameras, people are matched one to one so that the rays of their joints miss each other as
little as possible. The residual of a joint is the pixel error that both views would have to share
for its rays to meet: e = d / (z_a / f_a + z_b / f_b), with the rays' distance d and the depths z. It does
not depend on the unit of length, and is `BEHIND` where the rays meet behind a camera.

A wrong calibration moves the residuals of one person together, smoothly over the image; noise of the
detector scatters them. So the scatter about a plane over the person's joints measures the noise, whatever the
calibration is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.optimize import linear_sum_assignment

from panoptic_ros.domain import Camera, Rig, ViewDetections
from panoptic_ros.geometry import Intrinsics

Array = np.ndarray
BEHIND = 1e4  # px
SHARE = 0.4  # of the matched people that must meet: others may be ghosts or seen once only
LEAST_SCORE = 0.2  # of a joint that is used
LEAST_JOINTS = 5  # of a person that is used
LEAST_ANGLE = 0.1  # rad between two rays; flatter ones say nothing about each other's depth
ALL_PAIRS = 10  # cameras; with more, each is compared with NEIGHBOURS others, evenly spread
NEIGHBOURS = 6
EXTENTS_PER_S = 1.0  # a person walks at the speed of so many of their extents, 1.4 m/s
LATEST_S = 0.05  # between two views of an instant, of which that is allowed for; more is a fault of clocks
PLANE = 3  # coefficients of a plane over the image
FEWEST_FOR_NOISE = 7  # joints, of which the plane takes three
SIGMA = 1.4826  # standard deviations in a median absolute deviation, of the normal distribution


@dataclass(frozen=True, eq=False)
class Met:
    """People matched between two cameras, over all instants.

    Args:
        pixels: (M,) median over the joints of the residual, px, without what walking explains where the two
            images are of different times.
        metres: (M,) median distance of the rays, in the unit of the rig.
        points: (M, J, 3) midway between the rays, NaN where a joint is missing.
        signed: (M, J) residual with its sign, px, NaN where a joint is missing.
        plane: (M, J, 2) the joints in the first view, on the plane at distance 1.
    """

    pixels: Array
    metres: Array
    points: Array
    signed: Array
    plane: Array

    @classmethod
    def nobody(cls) -> Met:
        """Return an empty match."""
        return cls(np.zeros(0), np.zeros(0), np.zeros((0, 0, 3)), np.zeros((0, 0)), np.zeros((0, 0, 2)))

    @cached_property
    def typical(self) -> tuple[float, float]:
        """The residual that a `SHARE` of the people have, px, and the distance, in the unit of the rig."""
        return float(np.quantile(self.pixels, SHARE)), float(np.quantile(self.metres, SHARE))

    def noise(self) -> Array:
        """Return the standard deviation (M,) of the residuals about a plane over the image, px.

        NaN for people with too few joints.
        """
        found = np.full(len(self.signed), np.nan)
        there = np.isfinite(self.signed) & np.isfinite(self.plane).all(-1)
        for k in np.flatnonzero(there.sum(1) >= FEWEST_FOR_NOISE):
            values, places = self.signed[k, there[k]], self.plane[k, there[k]]
            design = np.column_stack([np.ones(len(values)), places])
            rest = values - design @ np.linalg.lstsq(design, values, rcond=None)[0]
            found[k] = SIGMA * np.median(np.abs(rest)) * np.sqrt(len(rest) / (len(rest) - PLANE))
        return found


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
        """Return unit rays (F, P, J, 3) in the world for F views, NaN for joints of no or low score."""
        each = self._in_camera(camera.intrinsics, views)
        people = max(len(rays) for rays in each)
        stack = np.full((len(each), people, *each[0].shape[1:]), np.nan)
        for row, rays in zip(stack, each):
            row[: len(rays)] = rays
        rotated: Array = stack @ camera.cam_from_world.rotation
        return rotated

    def _in_camera(self, intrinsics: Intrinsics, views: Sequence[ViewDetections]) -> list[Array]:
        """Return rays (P, J, 3) of every view in the axes of its camera."""
        new = [view for view in views if (intrinsics, view) not in self._rays]
        if new:  # all at once: undistorting takes iterations
            points = [np.where((view.scores >= LEAST_SCORE)[..., None], view.points, np.nan) for view in new]
            plane = intrinsics.undistort(np.concatenate(points))
            rays = np.concatenate([plane, np.ones_like(plane[..., :1])], axis=-1)
            rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
            ends = np.cumsum([len(part) for part in points])
            for view, own in zip(new, np.split(rays, ends[:-1])):
                self._rays[intrinsics, view] = own
        return [self._rays[intrinsics, view] for view in views]


def meet(
    camera_a: Camera,
    camera_b: Camera,
    views: Sequence[tuple[ViewDetections, ViewDetections]],
    cache: RayCache,
) -> Met:
    """The people that two cameras saw at the same instants, matched one to one."""
    if not views:
        return Met.nobody()
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
    pixels = distance * _scale(camera_a, camera_b, depth_a, depth_b)
    pixels = np.where((depth_a > 0.0) & (depth_b > 0.0), pixels, BEHIND)
    known = sine2 > LEAST_ANGLE**2  # False where a joint is missing
    enough = known.sum(-1) >= LEAST_JOINTS
    residual = _median(pixels, known, enough)
    at = _matches(residual, enough)
    halfway = camera_a.centre + depth_a[at][..., None] * rays_a[at[0], at[1], 0] + 0.5 * gap[at]
    points = np.where(known[at][..., None], halfway, np.nan)
    seen, scale = known[at], _scale(camera_a, camera_b, depth_a[at], depth_b[at])
    plane = np.where(seen[..., None], _plane(rays_a[at[0], at[1], 0], camera_a), np.nan)
    normals = np.cross(rays_a[at[0], at[1], 0], rays_b[at[0], 0, at[2]])
    with np.errstate(divide="ignore", invalid="ignore"):
        signed = (normals @ offset) / np.linalg.norm(normals, axis=-1) * scale
    late = np.array([1e-9 * abs(a.stamp_ns - b.stamp_ns) for a, b in views])[at[0]]
    walked = EXTENTS_PER_S * np.minimum(late, LATEST_S) * _extent(plane) * _focal(camera_a)
    return Met(
        np.maximum(residual[at] - walked, 0.0),
        _median(distance, known, enough)[at],
        points,
        np.where(seen, signed, np.nan),
        plane,
    )


def _scale(camera_a: Camera, camera_b: Camera, depth_a: Array, depth_b: Array) -> Array:
    """Return pixels per unit of length (M, J) at these distances along the rays."""
    with np.errstate(divide="ignore", invalid="ignore"):
        scale: Array = 1.0 / (np.abs(depth_a) / _focal(camera_a) + np.abs(depth_b) / _focal(camera_b))
    return scale


def _plane(rays: Array, camera: Camera) -> Array:
    """Return where rays (M, J, 3) of the world meet the camera's plane at distance 1, (M, J, 2)."""
    own = rays @ camera.cam_from_world.rotation.T
    with np.errstate(divide="ignore", invalid="ignore"):
        plane: Array = own[..., :2] / own[..., 2:]
    return plane


def _extent(plane: Array) -> Array:
    """Return the size (M,) of people on the plane (M, J, 2), NaN = not seen."""
    if not len(plane):
        return np.zeros(0)
    there = np.isfinite(plane)
    low, high = np.where(there, plane, np.inf).min(1), np.where(there, plane, -np.inf).max(1)
    extent: Array = np.linalg.norm(high - low, axis=-1)
    return extent


def _matches(residual: Array, enough: Array) -> tuple[Array, Array, Array]:
    """Indices (instant, person of a, person of b) of the best matching of each instant."""
    found = []
    for instant, (costs, allowed) in enumerate(zip(residual, enough)):
        rows, columns = linear_sum_assignment(np.where(allowed, np.minimum(costs, BEHIND), 2 * BEHIND))
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
