"""Compiled normal equations of the bundle adjustment: poses of targets and shifts of views are eliminated.

Observations are sorted by view. A view is a target at one instant in one camera; views are sorted by target.
The unknowns of a camera are its pose (rotation vector that perturbs from the left, translation), lens, clock
offset: `projection.CAMERA`. A target has a pose, or only a position if it is one point.
"""

from __future__ import annotations

import math

import numpy as np

from panoptic_ros.calibration.projection import CAMERA, OFFSET, POSE, derivatives, project
from panoptic_ros.geometry.robust import growth
from panoptic_ros.geometry.rotations import rotation_of
from panoptic_ros.kernels import inlined, njit

BEHIND = 1e4  # px, residual of a point behind the camera
VIEW = CAMERA + POSE  # unknowns that a view depends on, without its shift

_growth = inlined(growth)
_jit = njit(cache=True, error_model="numpy", nogil=True)


@inlined
def _world(turn, move, point):
    """Return the world coordinates of a point of a target, and its coordinates rotated to the world."""
    x = turn[0, 0] * point[0] + turn[0, 1] * point[1] + turn[0, 2] * point[2]
    y = turn[1, 0] * point[0] + turn[1, 1] * point[1] + turn[1, 2] * point[2]
    z = turn[2, 0] * point[0] + turn[2, 1] * point[1] + turn[2, 2] * point[2]
    return x + move[0], y + move[1], z + move[2], x, y, z


@_jit
def residuals(seen, lenses, fisheye, rotations, translations, offsets, turns, moves, shifts):
    """Return the residuals (M, 2) px: projection minus pixel, which image velocity moves to the instant.

    Args:
        seen: `bundle.Observations` as a record of arrays.
        lenses, fisheye, rotations, translations, offsets: of the cameras (C, ...).
        turns, moves: (B, 3, 3), (B, 3) m, world from target.
        shifts: (V,) s, time shift of each view.
    """
    out = np.empty((len(seen.pixels), 2))
    pixel = np.empty(2)
    for v in range(len(seen.cameras)):
        c, b = seen.cameras[v], seen.targets[v]
        late = offsets[c] + shifts[v]
        for m in range(seen.starts[v], seen.starts[v + 1]):
            x, y, z, _, _, _ = _world(turns[b], moves[b], seen.points[m])
            if project(lenses[c], fisheye[c], rotations[c], translations[c], x, y, z, pixel):
                for i in range(2):
                    out[m, i] = pixel[i] - seen.pixels[m, i] + late * seen.speeds[m, i]
            else:
                out[m, 0] = out[m, 1] = BEHIND
    return out


@_jit
def linearise(seen, lenses, fisheye, rotations, translations, offsets, turns, moves, shifts, jitter, scale):
    """Return the normal equations of all views, with the shift of each view eliminated.

    Args:
        jitter: (C,) s, standard deviation of the shifts of a camera; 0 = views have no shift.
        scale: scale of the Cauchy weights, in standard deviations.

    Returns:
        own: (C, CAMERA, CAMERA) information of the cameras, own_right: (C, CAMERA) right-hand sides.
        cross: (V, CAMERA, 6) of views. target: (B, 6, 6), target_right: (B, 6).
        shift: (V, VIEW + 2), coefficients from which `eliminated_shifts` gets the shifts.
    """
    views, cameras, blocks = len(seen.cameras), len(lenses), len(turns)
    own, own_right = np.zeros((cameras, CAMERA, CAMERA)), np.zeros((cameras, CAMERA))
    cross = np.zeros((views, CAMERA, POSE))
    target, target_right = np.zeros((blocks, POSE, POSE)), np.zeros((blocks, POSE))
    shift = np.zeros((views, VIEW + 2))
    pixel, by_camera, by_point = np.empty(2), np.empty((2, OFFSET)), np.empty((2, 3))
    row = np.empty((2, VIEW))
    square, right = np.empty((VIEW, VIEW)), np.empty(VIEW)
    for v in range(views):
        c, b = seen.cameras[v], seen.targets[v]
        late = offsets[c] + shifts[v]
        square[:], right[:] = 0.0, 0.0
        side, weight_of_shift, right_of_shift = shift[v, :VIEW], 0.0, 0.0
        for m in range(seen.starts[v], seen.starts[v + 1]):
            x, y, z, dx, dy, dz = _world(turns[b], moves[b], seen.points[m])
            if not derivatives(
                lenses[c], fisheye[c], rotations[c], translations[c], x, y, z, pixel, by_camera, by_point
            ):
                continue
            sx, sy = seen.speeds[m, 0], seen.speeds[m, 1]
            rx, ry = pixel[0] - seen.pixels[m, 0] + late * sx, pixel[1] - seen.pixels[m, 1] + late * sy
            weight = 1.0 / (
                seen.variances[m] * _growth((rx * rx + ry * ry) / seen.variances[m], scale)
            )
            for i in range(2):
                row[i, :OFFSET] = by_camera[i]
                row[i, OFFSET] = seen.speeds[m, i]
                px, py, pz = by_point[i, 0], by_point[i, 1], by_point[i, 2]
                row[i, CAMERA], row[i, CAMERA + 1] = pz * dy - py * dz, px * dz - pz * dx
                row[i, CAMERA + 2] = py * dx - px * dy
                row[i, CAMERA + 3], row[i, CAMERA + 4], row[i, CAMERA + 5] = px, py, pz
            for p in range(VIEW):
                wx, wy = weight * row[0, p], weight * row[1, p]
                right[p] -= wx * rx + wy * ry
                side[p] += wx * sx + wy * sy
                for q in range(p + 1):
                    square[p, q] += wx * row[0, q] + wy * row[1, q]
            weight_of_shift += weight * (sx * sx + sy * sy)
            right_of_shift -= weight * (sx * rx + sy * ry)
        if jitter[c] > 0.0:
            own_weight = 1.0 / (jitter[c] * jitter[c])
            weight_of_shift += own_weight
            right_of_shift -= own_weight * shifts[v]
            for p in range(VIEW):
                right[p] -= side[p] * right_of_shift / weight_of_shift
                for q in range(p + 1):
                    square[p, q] -= side[p] * side[q] / weight_of_shift
            shift[v, VIEW], shift[v, VIEW + 1] = weight_of_shift, right_of_shift
        for p in range(CAMERA):
            own_right[c, p] += right[p]
            for q in range(p + 1):
                own[c, p, q] += square[p, q]
                if q < p:
                    own[c, q, p] += square[p, q]
            for q in range(POSE):
                cross[v, p, q] = square[CAMERA + q, p]
        for p in range(POSE):
            target_right[b, p] += right[CAMERA + p]
            for q in range(p + 1):
                target[b, p, q] += square[CAMERA + p, CAMERA + q]
                if q < p:
                    target[b, q, p] += square[CAMERA + p, CAMERA + q]
    return own, own_right, cross, target, target_right, shift


@_jit
def reduce_to_cameras(targets, cameras, starts, index, inverse, cross, target_right, reduced, right):
    """Subtract the eliminated targets from the normal equations of the cameras (Schur complement), in place.

    Args:
        targets: (V,) target of each view. cameras: (V,). starts: (B + 1,) first view of each target.
        index: (C, CAMERA) row of each unknown in `reduced`, -1 = fixed.
        inverse: (B, 6, 6) inverse information of the targets, 0 in rows of fixed unknowns.
        cross: (V, CAMERA, 6), target_right: (B, 6), as returned by `linearise`.
        reduced: (N, N), right: (N,), changed.
    """
    for b in range(len(starts) - 1):
        move = inverse[b] @ target_right[b]
        for v in range(starts[b], starts[b + 1]):
            gain = cross[v] @ inverse[b]
            for p in range(CAMERA):
                row = index[cameras[v], p]
                if row < 0:
                    continue
                for k in range(POSE):
                    right[row] -= cross[v, p, k] * move[k]
            for w in range(starts[b], starts[b + 1]):
                for p in range(CAMERA):
                    row = index[cameras[v], p]
                    if row < 0:
                        continue
                    for q in range(CAMERA):
                        column = index[cameras[w], q]
                        if column < 0:
                            continue
                        total = 0.0
                        for k in range(POSE):
                            total += gain[p, k] * cross[w, q, k]
                        reduced[row, column] -= total


@_jit
def moved(rotations, translations, steps):
    """Return poses (N, 3, 3), (N, 3) after steps (N, 6): rotation vectors from the left, translations."""
    turned, shifted = np.empty_like(rotations), translations + steps[:, 3:]
    turn = np.empty((3, 3))
    for n in range(len(rotations)):
        rotation_of(steps[n, :3], turn)
        turned[n] = turn @ rotations[n]
    return turned, shifted


@_jit
def cost_of(residuals, variances, scale):
    """Return the sum of the Cauchy losses of residuals (M, 2) px with variances (M,) px^2."""
    total = 0.0
    for m in range(len(residuals)):
        square = (residuals[m, 0] ** 2 + residuals[m, 1] ** 2) / variances[m]
        total += scale * scale * math.log(1.0 + square / (scale * scale))
    return total
