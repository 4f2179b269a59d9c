"""Evidence of the views about the rotation and focal length of each camera.

A joint is triangulated from all other cameras (leave-one-out). The residual of the camera's own 2D joint is
linear in four parameters: a rotation about the camera's centre (rad, camera axes), and the logarithm of its
focal length. The kernel adds the normal equations of these parameters.
"""

from __future__ import annotations

import numpy as np

from panoptic_ros.geometry.robust import noise_growth
from panoptic_ros.kernels import njit

Array = np.ndarray
SPREAD = 0.02  # m, standard deviation of a 2D joint at the depth of the person: noise and bias of a detector
SCALE = 2.0  # residual / standard deviation at which the weight of a residual is half (Cauchy)
GATE = 0.25  # m, residual at the depth of the person beyond which a 2D joint is another joint
LOOSE = 1.0 / 0.3**2  # 1/m^2, information that a joint is where the skeleton states it: 0.3 m
NEAREST = 0.2  # m, smallest depth of a used joint


@njit(cache=True, error_model="numpy", nogil=True)
def add_evidence(
    rotations,
    translations,
    trusted,
    cameras,
    starts,
    rows,
    plane,
    scores,
    delays,
    persons,
    positions,
    velocities,
    expected,
    normals,
    vectors,
    seen,
):
    """Add the normal equations of one instant: C cameras, V views, D 2D poses, P people, J joints.

    Args:
        rotations, translations: (C, 3, 3), (C, 3) m of cam_from_world.
        trusted: (C,) bool, cameras whose views triangulate joints.
        cameras, starts, rows, plane, scores, delays: Arrays of `domain.Evidence`.
        persons: (P, V) row of each person's 2D pose in its view, -1 = none.
        positions: (P, J, 3) m, joints, NaN = missing.
        velocities: (P, 3) m/s, velocity of each body.
        expected: (C, 4) parameters at which robust weights are taken.
        normals, vectors: (C, 4, 4), (C, 4) sums that are added to.
        seen: (C, P) bool, becomes true where a person gave evidence about a camera.
    """
    people, joints = positions.shape[:2]
    views = len(cameras)
    member = np.empty(views, np.int64)
    used = np.zeros(views, np.bool_)
    spots = np.empty((views, 3))
    apart = np.empty((views, 2))
    slopes = np.empty((views, 2, 3))
    weights = np.empty(views)
    total, others, inverse = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    pull, own = np.empty(3), np.empty(3)
    residual, spread = np.empty(2), np.empty((2, 2))
    slope = np.empty((2, 4))
    for p in range(people):
        for v in range(views):
            member[v] = -1
            if persons[p, v] >= 0:
                for d in range(starts[v], starts[v + 1]):
                    if rows[d] == persons[p, v]:
                        member[v] = d
        for j in range(joints):
            if not np.isfinite(positions[p, j, 0]):
                continue
            total[:], pull[:] = 0.0, 0.0
            count = 0
            for v in range(views):
                used[v] = False
                d = member[v]
                if d < 0 or scores[d, j] <= 0.0:
                    continue
                c = cameras[v]
                turn = rotations[c]
                for a in range(3):
                    spots[v, a] = translations[c, a]
                    for b in range(3):
                        spots[v, a] += turn[a, b] * (positions[p, j, b] + delays[v] * velocities[p, b])
                depth = spots[v, 2]
                if depth < NEAREST:
                    continue
                x, y = spots[v, 0] / depth, spots[v, 1] / depth
                apart[v, 0], apart[v, 1] = plane[d, j, 0] - x, plane[d, j, 1] - y
                away = depth * np.sqrt(apart[v, 0] ** 2 + apart[v, 1] ** 2)
                if away > GATE:
                    continue
                used[v] = True
                weights[v] = (depth / SPREAD) ** 2
                for a in range(3):
                    slopes[v, 0, a] = (turn[0, a] - x * turn[2, a]) / depth
                    slopes[v, 1, a] = (turn[1, a] - y * turn[2, a]) / depth
                if trusted[c]:
                    count += 1
                    _add(total, pull, slopes[v], apart[v], _robust(weights[v], away))
            for v in range(views):
                c = cameras[v]
                if not used[v] or count - trusted[c] < 2:
                    continue
                others[:], own[:] = total, pull
                if trusted[c]:
                    away = spots[v, 2] * np.sqrt(apart[v, 0] ** 2 + apart[v, 1] ** 2)
                    _add(others, own, slopes[v], apart[v], -_robust(weights[v], away))
                for a in range(3):
                    others[a, a] += LOOSE
                _invert(others, inverse)
                _without_own(slopes[v], inverse, own, apart[v], residual, spread)
                _add_joint(spots[v], residual, spread, weights[v], expected[c], slope, normals[c], vectors[c])
                seen[c, p] = True


@njit(cache=True, error_model="numpy", nogil=True)
def _robust(weight, away):
    """Return the Cauchy weight of a residual of `away` m, times `weight`."""
    return weight / noise_growth((away / SPREAD) ** 2, SCALE)


@njit(cache=True, error_model="numpy", nogil=True)
def _add(total, pull, slope, apart, weight):
    """Add a view's normal equations (3, 3), (3,) of a joint."""
    for a in range(3):
        pull[a] += weight * (slope[0, a] * apart[0] + slope[1, a] * apart[1])
        for b in range(3):
            total[a, b] += weight * (slope[0, a] * slope[0, b] + slope[1, a] * slope[1, b])


@njit(cache=True, error_model="numpy", nogil=True)
def _invert(matrix, inverse):
    """Write the inverse of a symmetric positive definite matrix (3, 3)."""
    a, b, c = matrix[0, 0], matrix[0, 1], matrix[0, 2]
    d, e, f = matrix[1, 1], matrix[1, 2], matrix[2, 2]
    inverse[0, 0] = d * f - e * e
    inverse[0, 1] = c * e - b * f
    inverse[0, 2] = b * e - c * d
    inverse[1, 1] = a * f - c * c
    inverse[1, 2] = b * c - a * e
    inverse[2, 2] = a * d - b * b
    scale = 1.0 / (a * inverse[0, 0] + b * inverse[0, 1] + c * inverse[0, 2])
    for i in range(3):
        for k in range(i, 3):
            inverse[i, k] *= scale
            inverse[k, i] = inverse[i, k]


@njit(cache=True, error_model="numpy", nogil=True)
def _without_own(slope, inverse, own, apart, residual, spread):
    """Write the residual (2,) and covariance (2, 2) of a joint that the other cameras triangulate.

    Args:
        slope: (2, 3) derivative of the projected joint by its position.
        inverse, own: Inverse normal matrix (3, 3) and right-hand side (3,) of the other cameras.
        apart: (2,) residual at the skeleton's position.
    """
    for i in range(2):
        residual[i] = apart[i]
        for a in range(3):
            part = 0.0
            for b in range(3):
                part += inverse[a, b] * own[b]
            residual[i] -= slope[i, a] * part
        for k in range(2):
            spread[i, k] = 0.0
            for a in range(3):
                for b in range(3):
                    spread[i, k] += slope[i, a] * inverse[a, b] * slope[k, b]


@njit(cache=True, error_model="numpy", nogil=True)
def _add_joint(spot, residual, spread, weight, expected, slope, normal, vector):
    """Add the normal equations of a camera's parameters by one joint.

    They are those of a Newton step from `expected`. The Hessian of the Cauchy cost, averaged over directions
    in the image, has the square of the gradient's weight. With the weight itself, changes come out too small.

    Args:
        spot: (3,) m, the joint in the camera's frame.
        residual: (2,) of the joint against the other cameras, on the plane at depth 1.
        spread: (2, 2) covariance of the other cameras' joint, projected on that plane.
        weight: Inverse variance of the camera's own 2D joint on that plane.
        expected, normal, vector: (4,), (4, 4), (4,), see `add_evidence`.
        slope: (2, 4) work space.
    """
    x, y = spot[0] / spot[2], spot[1] / spot[2]
    slope[0, 0], slope[0, 1], slope[0, 2], slope[0, 3] = -x * y, 1.0 + x * x, -y, x
    slope[1, 0], slope[1, 1], slope[1, 2], slope[1, 3] = -1.0 - y * y, x * y, x, y
    a, b, c = spread[0, 0] + 1.0 / weight, spread[0, 1], spread[1, 1] + 1.0 / weight
    scale = 1.0 / (a * c - b * b)
    u, v = residual[0], residual[1]
    for i in range(4):
        u -= slope[0, i] * expected[i]
        v -= slope[1, i] * expected[i]
    square = scale * (c * u**2 - 2.0 * b * u * v + a * v**2)
    robust = 1.0 / noise_growth(square, SCALE)
    scale *= robust
    for i in range(4):
        first = scale * (c * slope[0, i] - b * slope[1, i])
        second = scale * (a * slope[1, i] - b * slope[0, i])
        vector[i] += first * u + second * v
        for k in range(4):
            curvature = robust * (first * slope[0, k] + second * slope[1, k])
            normal[i, k] += curvature
            vector[i] += curvature * expected[k]
