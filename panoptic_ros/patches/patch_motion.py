"""Motion of a patch relative to its part, from nearby tracks, and its visibility per view; compiled."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.kernels import njit

Array = np.ndarray
SOFT = 0.005  # m, standard deviation of a patch's motion relative to its part
NEAR = 0.03  # m, standard deviation of the Gaussian weight of nearby tracks
BEST_VIEWS = 6  # greatest number of views that measure a patch
GRAZING = 0.15  # least cosine between normal and view direction for a view that counts
LEAST_WEIGHT = 0.2  # least weight of the tracks near a patch for a view that counts
# Coefficients of the logit of visibility: constant, cosine of the view angle, weight of nearby tracks,
# visibility at the previous instant.
VISIBLE = (-2.2, 1.5, 2.5, 1.0)


class PatchMeasurements(NamedTuple):
    """Measurements of N patches."""

    corrections: Array  # (N, 3) m, relative to the motion of their parts
    sigmas: Array  # (N,) m
    visible: Array  # (N, V) in 0..1


@njit(cache=True, error_model="numpy", nogil=True)
def measure(before, after, normals, numbers, starts, tracks, carried, views, seen, found):
    """Measure each patch from the nearby tracks of its part: the triangulated residual motion.

    Args:
        before: (N, 3) m, positions at the first instant.
        after: (N, 3) m, positions as moved by the parts.
        normals: (N, 3), at the second instant.
        numbers: (N,) group of tracks of each patch.
        starts: First track of each group.
        carried: (T, 3) m, points of the tracks as moved by the parts.
        views: (V, 3, 4) cam_from_world.
        seen: (N, V) visibility at the previous instant.
        found: `PatchMeasurements`, output.
    """
    count = len(views)
    weights, cosines = np.empty(count), np.empty(count)
    normal, gradient, used = np.empty((3, 3)), np.empty(3), np.empty(count, np.bool_)
    information, rests = np.empty((count, 3)), np.empty((count, 2))
    for n in range(len(before)):
        first, last = starts[numbers[n]], starts[numbers[n] + 1]
        for v in range(count):
            weights[v], used[v] = 0.0, False
            information[v], rests[v] = 0.0, 0.0
            cosines[v] = _cosine(views[v], after[n], normals[n])
        for t in range(first, last):
            square = 0.0
            for i in range(3):
                square += (tracks.points[t, i] - before[n, i]) ** 2
            if square > 9.0 * NEAR * NEAR:
                continue
            weight, v, view = np.exp(-0.5 * square / NEAR**2), tracks.cameras[t], views[tracks.cameras[t]]
            depth = _row(view, 2, carried[t])
            weights[v] += weight
            for i in range(3):
                information[v, i] += weight * tracks.information[t, i]
            for i in range(2):
                rests[v, i] += weight * (tracks.targets[t, i] - _row(view, i, carried[t]) / depth)
        for v in range(count):
            logit = (
                VISIBLE[0]
                + VISIBLE[1] * cosines[v]
                + VISIBLE[2] * min(weights[v], 1.0)
                + VISIBLE[3] * seen[n, v]
            )
            found.visible[n, v] = (
                1.0 / (1.0 + np.exp(-logit)) if weights[v] > 0.0 or cosines[v] > 0.0 else 0.0
            )
            if weights[v] > 0.0:
                for i in range(2):
                    rests[v, i] /= weights[v]
                for i in range(3):
                    information[v, i] /= max(weights[v], 1.0)
        normal[:], gradient[:] = 0.0, 0.0
        for i in range(3):
            normal[i, i] = 1.0 / SOFT**2
        for _ in range(min(BEST_VIEWS, count)):
            best, score = -1, 0.0
            for v in range(count):
                worth = cosines[v] * min(weights[v], 1.0)
                if not used[v] and cosines[v] > GRAZING and weights[v] > LEAST_WEIGHT and worth > score:
                    best, score = v, worth
            if best < 0:
                break
            used[best] = True
            _add(views[best], after[n], information[best], rests[best], normal, gradient)
        inverse = np.linalg.inv(normal)
        trace = 0.0
        for i in range(3):
            trace += inverse[i, i]
            for k in range(3):
                found.corrections[n, i] += inverse[i, k] * gradient[k]
        found.sigmas[n] = np.sqrt(trace / 3.0)


@njit(cache=True, error_model="numpy", nogil=True)
def _add(view, point, information, rest, normal, gradient):
    """Add a view's measurement of a point's motion to the normal equations.

    Args:
        information: (3,) xx, xy, yy on the plane at distance 1.
        rest: (2,) residual motion on that plane.
    """
    depth = _row(view, 2, point)
    rows = np.empty((2, 3))
    for i in range(2):
        slope = _row(view, i, point) / depth
        for k in range(3):
            rows[i, k] = (view[i, k] - slope * view[2, k]) / depth
    a, b, c = information[0], information[1], information[2]
    growth = 1.0 + 0.25 * (a * rest[0] ** 2 + 2.0 * b * rest[0] * rest[1] + c * rest[1] ** 2)
    for i in range(3):
        along = (a * rows[0, i] + b * rows[1, i]) / growth
        across = (b * rows[0, i] + c * rows[1, i]) / growth
        gradient[i] += along * rest[0] + across * rest[1]
        for k in range(3):
            normal[i, k] += along * rows[0, k] + across * rows[1, k]


@njit(cache=True, error_model="numpy", nogil=True)
def _cosine(view, point, normal):
    """Return the cosine of the angle between a point's normal and its direction to a camera; -1 behind it."""
    if _row(view, 2, point) <= 0.0:
        return -1.0
    along, square = 0.0, 0.0
    for i in range(3):
        place = 0.0  # camera centre minus the point: - R^T (R x + t)
        for k in range(3):
            place -= view[k, i] * _row(view, k, point)
        along += place * normal[i]
        square += place * place
    return along / np.sqrt(square)


@njit(cache=True, error_model="numpy", nogil=True)
def _row(view, i, point):
    """Return coordinate i of a point (3,) in the frame of a camera."""
    return view[i, 0] * point[0] + view[i, 1] * point[1] + view[i, 2] * point[2] + view[i, 3]
