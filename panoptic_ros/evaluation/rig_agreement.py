"""Agreement of camera pairs, measured by how closely the rays of people meet, without any solver.

For two cameras, people are matched one to one so that the rays of their joints have the smallest distances.
The residual of a joint is the pixel error that both views would have to share for its rays to meet. It is e =
d / (z_a / f_a + z_b / f_b), with the rays' distance d and the depths z. It does not depend on the unit of
length, and is `BEHIND` where the rays meet behind a camera.

A wrong calibration changes the residuals of one person together, smoothly over the image; detector noise
scatters them. So the scatter about a plane over the person's joints measures the noise, independently of the
calibration.
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
BEHIND = 1e4  # px; residual of rays that meet behind a camera
# quantile of matched people that must agree, since others may be ghosts or visible to one camera only
SHARE = 0.4
LEAST_SCORE = 0.2  # smallest score of a joint that is used
LEAST_JOINTS = 5  # smallest number of joints of a person that is used
# rad; smallest angle between two rays, since flatter ones do not determine each other's depth
LEAST_ANGLE = 0.1
# largest number of cameras with all pairs compared; beyond it, each has NEIGHBOURS evenly spread partners
ALL_PAIRS = 10
NEIGHBOURS = 6
EXTENTS_PER_S = 1.0  # walking speed in body extents per second, which is 1.4 m/s
# s; largest time difference between two views whose motion is allowed for; more is a clock fault
LATEST_S = 0.05
PLANE = 3  # coefficients of a plane over the image
FEWEST_FOR_NOISE = 7  # smallest number of joints for a noise estimate; the plane uses up three of them
SIGMA = 1.4826  # ratio of the standard deviation to the median absolute deviation, normal distribution


@dataclass(frozen=True, eq=False)
class MatchedPairs:
    """People matched between two cameras, over all instants.

    Args:
        pixels: Median residual (M,) px over the joints, less the part that walking explains where the two
            images have different times.
        metres: Median distance (M,) of the rays, in the unit of the rig.
        points: Midpoints (M, J, 3) between the rays, NaN where a joint is missing.
        signed: Signed residual (M, J) px, NaN where a joint is missing.
        plane: Joints (M, J, 2) in the first view, on the plane at distance 1.
    """

    pixels: Array
    metres: Array
    points: Array
    signed: Array
    plane: Array

    @classmethod
    def nobody(cls) -> MatchedPairs:
        """Return an empty match."""
        return cls(np.zeros(0), np.zeros(0), np.zeros((0, 0, 3)), np.zeros((0, 0)), np.zeros((0, 0, 2)))

    @cached_property
    def typical(self) -> tuple[float, float]:
        """Return the `SHARE` quantile over people of the residual (px) and of the distance (rig's unit)."""
        return float(np.quantile(self.pixels, SHARE)), float(np.quantile(self.metres, SHARE))

    def noise(self) -> Array:
        """Return the standard deviation (M,) px of the residuals about a plane over the image.

        It is NaN for people with too few joints.
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
    """Return the camera pairs (a, b), a < b, to compare."""
    count = len(rig)
    if count <= ALL_PAIRS:
        return [(a, b) for a in range(count) for b in range(a + 1, count)]
    steps = {max(1, round(count * k / (NEIGHBOURS + 1))) for k in range(1, NEIGHBOURS + 1)}
    others = [(a, (a + step) % count) for a in range(count) for step in steps]
    return sorted({(min(a, b), max(a, b)) for a, b in others if a != b})


class RayCache:
    """Cache of undistorted view points, so that trying other poses does not repeat the undistortion."""

    def __init__(self) -> None:
        self._rays: dict[tuple[Intrinsics, ViewDetections], Array] = {}

    def rays(self, camera: Camera, views: Sequence[ViewDetections]) -> Array:
        """Return unit rays (F, P, J, 3) in the world for F views, NaN for joints with no or a low score."""
        each = self._in_camera(camera.intrinsics, views)
        people = max(len(rays) for rays in each)
        stack = np.full((len(each), people, *each[0].shape[1:]), np.nan)
        for row, rays in zip(stack, each):
            row[: len(rays)] = rays
        rotated: Array = stack @ camera.cam_from_world.rotation
        return rotated

    def _in_camera(self, intrinsics: Intrinsics, views: Sequence[ViewDetections]) -> list[Array]:
        """Return the rays (P, J, 3) of every view in camera axes."""
        new = [view for view in views if (intrinsics, view) not in self._rays]
        if new:  # undistort all new views at once, because undistortion is iterative
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
) -> MatchedPairs:
    """Return the people that two cameras saw at the same instants, matched one to one."""
    if not views:
        return MatchedPairs.nobody()
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
    return MatchedPairs(
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
    """Return the intersections (M, J, 2) of world rays (M, J, 3) with the camera's plane at distance 1."""
    own = rays @ camera.cam_from_world.rotation.T
    with np.errstate(divide="ignore", invalid="ignore"):
        plane: Array = own[..., :2] / own[..., 2:]
    return plane


def _extent(plane: Array) -> Array:
    """Return the size (M,) of people on the plane (M, J, 2), NaN = not visible."""
    if not len(plane):
        return np.zeros(0)
    there = np.isfinite(plane)
    low, high = np.where(there, plane, np.inf).min(1), np.where(there, plane, -np.inf).max(1)
    extent: Array = np.linalg.norm(high - low, axis=-1)
    return extent


def _matches(residual: Array, enough: Array) -> tuple[Array, Array, Array]:
    """Return indices (instant, person of a, person of b) of the best matching of each instant."""
    found = []
    for instant, (costs, allowed) in enumerate(zip(residual, enough)):
        rows, columns = linear_sum_assignment(np.where(allowed, np.minimum(costs, BEHIND), 2 * BEHIND))
        found += [(instant, a, b) for a, b in zip(rows, columns) if allowed[a, b]]
    table = np.array(found, dtype=int).reshape(-1, 3)
    return table[:, 0], table[:, 1], table[:, 2]


def _median(values: Array, known: Array, enough: Array) -> Array:
    """Return the lower median (P, Q) of the known values (P, Q, J); inf where there are too few."""
    ordered = np.sort(np.where(known, values, np.inf), axis=-1)
    middle = np.maximum((known.sum(-1) - 1) // 2, 0)
    median = np.take_along_axis(ordered, middle[..., None], axis=-1)[..., 0]
    return np.where(enough, median, np.inf)


def _focal(camera: Camera) -> float:
    return float(0.5 * np.trace(camera.intrinsics.matrix[:2, :2]))
