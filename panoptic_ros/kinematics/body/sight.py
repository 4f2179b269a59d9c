"""What views see of a body: how far 2D people are off it, and their joints as targets."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from panoptic_ros.kernels import njit

Array = np.ndarray
People = dict[int, tuple[Array, Array]]  # points (K, 2), NaN = missing, and scores (K,) by camera
NEAREST = 0.1  # m before a camera
FEWEST = 3  # joints that tell where somebody is


class Sites(NamedTuple):
    """Columns (N,) of the detections and places (N, 3) m where their joints are expected."""

    columns: Array
    places: Array

    @property
    def middle(self) -> Array:
        """The middle (3,) m of all joints."""
        found: Array = np.median(self.places, axis=0)
        return found

    def middle_seen(self, people: People) -> Array:
        """The middle (3,) m of the joints that views show, which may be those of a part of the body.

        Args:
            people: points (K, 2), NaN = missing, and scores (K,) by camera.
        """
        shown = [np.isfinite(points[self.columns]).all(-1) for points, _ in people.values()]
        middles = [np.median(self.places[there], axis=0) for there in shown if there.any()]
        found: Array = np.mean(middles, axis=0) if middles else self.middle
        return found


_jit = njit(cache=True, error_model="numpy", nogil=True)


@_jit
def distances(points: Array, columns: Array, places: Array, rotation: Array, translation: Array) -> Array:
    """How far 2D people are from where a body is expected, (P,) m: the median over the joints that are seen,
    as a length at the body's depth. Infinite if hardly any is seen, or the body is not before the camera.

    Args:
        points: (P, K, 2) on the plane, NaN = missing. columns: (N,) the joints that are compared.
        places: (N, 3) m, where these are expected.
        rotation, translation: (3, 3) and (3,) m, camera from world.
    """
    count = len(columns)
    found = np.full(len(points), math.inf)
    plane, depths = np.empty((count, 2)), np.empty(count)
    for n in range(count):
        x, y, z = places[n, 0], places[n, 1], places[n, 2]
        depth = rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2] * z + translation[2]
        if depth < NEAREST:
            return found
        depths[n] = depth
        for j in range(2):
            across = rotation[j, 0] * x + rotation[j, 1] * y + rotation[j, 2] * z + translation[j]
            plane[n, j] = across / depth
    middle = np.median(depths)
    apart = np.empty(count)
    for p in range(len(points)):
        seen = 0
        for n in range(count):
            u, v = points[p, columns[n], 0] - plane[n, 0], points[p, columns[n], 1] - plane[n, 1]
            if math.isfinite(u) and math.isfinite(v):
                apart[seen] = math.sqrt(u * u + v * v)
                seen += 1
        if seen >= FEWEST:
            found[p] = middle * np.median(apart[:seen])
    return found


@_jit
def known_joints(
    columns: Array, positions: Array, covariances: Array, own: float
) -> tuple[Array, Array, Array]:
    """Sites (M,) of the joints in space that are known, their positions (M, 3) and covariances (M, 3, 3).

    Args:
        columns: (N,) of the sites. positions, covariances: (K, 3) m and (K, 3, 3) m^2, NaN = not known.
        own: variance per axis that is added, m^2.
    """
    sites = np.empty(len(columns), np.int64)
    goals, spreads = np.empty((len(columns), 3)), np.empty((len(columns), 3, 3))
    count = 0
    for n in range(len(columns)):
        k = columns[n]
        if np.isfinite(positions[k]).all() and np.isfinite(covariances[k]).all():
            sites[count] = n
            goals[count], spreads[count] = positions[k], covariances[k]
            for i in range(3):
                spreads[count, i, i] += own
            count += 1
    return sites[:count], goals[:count], spreads[:count]


@_jit
def seen_joints(
    points: Array, scores: Array, columns: Array, factors: Array, power: float
) -> tuple[Array, Array, Array, Array]:
    """Sites (M,) of the joints that are seen, views (M,), points (M, 2) and weights (M,).

    Args:
        points, scores: (V, K, 2) on the plane, NaN = missing, and (V, K). columns: (N,) of the sites.
        factors: (V,) weight of a joint of score 1; it goes with the score to this power.
    """
    most = len(points) * len(columns)
    sites, views = np.empty(most, np.int64), np.empty(most, np.int64)
    found, weights = np.empty((most, 2)), np.empty(most)
    count = 0
    for view in range(len(points)):
        for n in range(len(columns)):
            x, y = points[view, columns[n], 0], points[view, columns[n], 1]
            score = scores[view, columns[n]]
            if score > 0.0 and math.isfinite(x) and math.isfinite(y):
                sites[count], views[count] = n, view
                found[count, 0], found[count, 1] = x, y
                weights[count] = factors[view] * (score if power == 1.0 else score**power)
                count += 1
    return sites[:count], views[:count], found[:count], weights[:count]
