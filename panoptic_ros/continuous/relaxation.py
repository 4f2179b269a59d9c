"""Adaptation of curves that were fitted joint by joint to lengths between the joints (kernels).

It costs a small part of the exact solution (`continuous.bones`) and gives no covariances.
"""

from __future__ import annotations

import numpy as np

from panoptic_ros.continuous.bones import SHORTEST
from panoptic_ros.geometry.splines import SPAN, weights_at
from panoptic_ros.kernels import njit
from panoptic_ros.solving.bands import backward, forward_vector


@njit(cache=True, error_model="numpy", nogil=True)
def relax(factors, points, grid, times, pairs, learnt, rounds):
    """Return the change (J, K, 3) m of curves that adapts them to the lengths.

    One Gauss-Newton step, solved by conjugate gradients. The unknowns are L^T c, so the systems of single
    joints are identities.

    Args:
        factors, points: see `CurveFit`; A = L L^T is the system of a joint.
        times: (T,) s, instants at which the lengths are measured.
        learnt: `LearntLengths`.
        rounds: number of iterations.
    """
    joints, count, _ = points.shape
    number = len(times)
    first, weights = np.empty(number, np.int64), np.empty((number, SPAN))
    for t in range(number):
        first[t] = weights_at((times[t] - grid.origin) / grid.step, grid.number, weights[t])
    places = np.empty((number, joints, 3))
    at_instants(points, places, first, weights)
    along, forces = np.empty((number, len(pairs), 3)), np.empty((number, len(pairs)))
    for t in range(number):
        for p in range(len(pairs)):
            length = 0.0
            for a in range(3):
                along[t, p, a] = places[t, pairs[p, 0], a] - places[t, pairs[p, 1], a]
                length += along[t, p, a] ** 2
            length = max(np.sqrt(length), SHORTEST)
            forces[t, p] = learnt.weights[p] * (learnt.lengths[p] - length)
            for a in range(3):
                along[t, p, a] /= length
    residual = np.zeros((joints, count, 3))
    add_forces(residual, forces, places, first, weights, along, pairs)
    solve_forward(factors, residual)
    change = np.zeros((joints, count, 3))
    direction = residual.copy()
    image, moved = np.empty((joints, count, 3)), np.empty((joints, count, 3))
    metric = (residual * residual).sum()
    for _ in range(rounds):
        if metric <= 0.0:
            break
        moved[:] = direction
        solve_backward(factors, moved)
        at_instants(moved, places, first, weights)
        for t in range(number):
            for p in range(len(pairs)):
                stretch = 0.0
                for a in range(3):
                    gap = places[t, pairs[p, 0], a] - places[t, pairs[p, 1], a]
                    stretch += along[t, p, a] * gap
                forces[t, p] = learnt.weights[p] * stretch
        image[:] = 0.0
        add_forces(image, forces, places, first, weights, along, pairs)
        solve_forward(factors, image)
        image += direction
        step = metric / (direction * image).sum()
        change += step * direction
        residual -= step * image
        following = (residual * residual).sum()
        direction = residual + (following / metric) * direction
        metric = following
    solve_backward(factors, change)
    return change


@njit(cache=True, error_model="numpy", nogil=True)
def at_instants(points, places, first, weights):
    """Write the values (T, J, 3) of curves with control points (J, K, 3).

    Args:
        first, weights: (T,) and (T, SPAN), see `geometry.splines.weights_at`.
    """
    for t in range(len(first)):
        for j in range(len(points)):
            for a in range(3):
                value = 0.0
                for m in range(SPAN):
                    value += weights[t, m] * points[j, first[t] + m, a]
                places[t, j, a] = value


@njit(cache=True, error_model="numpy", nogil=True)
def add_forces(out, forces, work, first, weights, along, pairs):
    """Add forces (T, P) along the pairs to the control points out (J, K, 3).

    Args:
        work: (T, J, 3) overwritten.
    """
    work[:] = 0.0
    for t in range(len(first)):
        for p in range(len(pairs)):
            for a in range(3):
                part = forces[t, p] * along[t, p, a]
                work[t, pairs[p, 0], a] += part
                work[t, pairs[p, 1], a] -= part
        for j in range(len(out)):
            for m in range(SPAN):
                for a in range(3):
                    out[j, first[t] + m, a] += weights[t, m] * work[t, j, a]


@njit(cache=True, error_model="numpy", nogil=True)
def solve_forward(factors, right):
    """Solve L x = right for each joint, right (J, K, 3), in place."""
    for j in range(len(right)):
        forward_vector(factors[j], right[j].reshape(right[j].size))


@njit(cache=True, error_model="numpy", nogil=True)
def solve_backward(factors, right):
    """Solve L^T x = right for each joint, right (J, K, 3), in place."""
    for j in range(len(right)):
        backward(factors[j], right[j].reshape(right[j].size))
