"""Views of a body: distances of 2D poses from the expected body, and visible joints as targets."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from panoptic_ros.kernels import njit

Array = np.ndarray
# one 2D pose by camera: points (K, 2), NaN = missing, and scores (K,)
People = dict[int, tuple[Array, Array]]
NEAREST = 0.1  # m, minimum depth in front of a camera
FEWEST = 3  # minimum number of visible joints that locate a person


class ExpectedJoints(NamedTuple):
    """Expected joints of a body.

    Attributes:
        columns: (N,) joint indices in the detections.
        places: (N, 3) m, expected positions.
    """

    columns: Array
    places: Array

    @property
    def middle(self) -> Array:
        """Return the median position (3,) m of all joints."""
        found: Array = np.median(self.places, axis=0)
        return found

    def middle_seen(self, people: People) -> Array:
        """Return the mean over views of the median expected position (3,) m of the visible joints.

        The visible joints may be only a part of the body. Without any, the result is `middle`.

        Args:
            people: Points (K, 2), NaN = missing, and scores (K,) by camera.
        """
        shown = [np.isfinite(points[self.columns]).all(-1) for points, _ in people.values()]
        middles = [np.median(self.places[there], axis=0) for there in shown if there.any()]
        found: Array = np.mean(middles, axis=0) if middles else self.middle
        return found


_jit = njit(cache=True, error_model="numpy", nogil=True)


@_jit
def distances(points: Array, columns: Array, places: Array, rotation: Array, translation: Array) -> Array:
    """Return the distance (P,) m of each 2D pose of a view from the expected body.

    It is the median image distance over the visible joints, as a length at the median depth of the body. It
    is infinite if too few joints are visible or the body is not in front of the camera.

    Args:
        points: (P, K, 2) on the normalised image plane, NaN = missing.
        columns: (N,) joints that are compared.
        places: (N, 3) m, their expected positions.
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
    """Return the known 3D joints: sites (M,), positions (M, 3) m and covariances (M, 3, 3) m^2.

    Args:
        columns: (N,) joint indices of the sites.
        positions, covariances: (K, 3) m and (K, 3, 3) m^2, NaN = unknown.
        own: Variance per axis, m^2, that is added to the covariances.
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
    """Return the visible 2D joints of all views: sites (M,), views (M,), points (M, 2) and weights (M,).

    Args:
        points, scores: (V, K, 2) on the normalised image plane, NaN = missing, and (V, K).
        columns: (N,) joint indices of the sites.
        factors: (V,) weights of a joint of score 1. The weight is proportional to the score to the power
            `power`.
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
