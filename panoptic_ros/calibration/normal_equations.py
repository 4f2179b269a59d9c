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
LEAST = 1e-6  # px^2, of a motion of 1 rad/s or 1 m/s: keeps motions defined in views of few points

_growth = inlined(growth)
_jit = njit(cache=True, error_model="numpy", nogil=True)


@inlined
def _rotated(turn, point):
    """Return a point (3,) of a target after a rotation (3, 3)."""
    x = turn[0, 0] * point[0] + turn[0, 1] * point[1] + turn[0, 2] * point[2]
    y = turn[1, 0] * point[0] + turn[1, 1] * point[1] + turn[1, 2] * point[2]
    z = turn[2, 0] * point[0] + turn[2, 1] * point[1] + turn[2, 2] * point[2]
    return x, y, z


@_jit
def _move_on(turn, move, twist, late, change, turned, moved_to):
    """Write the pose of a target some time after its instant.

    Args:
        turn, move: (3, 3), (3,) m, pose at the instant.
        twist: (6,) rad/s and m/s, motion of the target in the world, rotation from the left.
        late: s, time after the instant.
        change: (3, 3) output, rotation since the instant. turned, moved_to: output, pose.
    """
    vector = np.empty(3)
    for k in range(3):
        vector[k] = twist[k] * late
        moved_to[k] = move[k] + twist[3 + k] * late
    rotation_of(vector, change)
    for i in range(3):
        for j in range(3):
            turned[i, j] = change[i, 0] * turn[0, j] + change[i, 1] * turn[1, j] + change[i, 2] * turn[2, j]


@_jit
def residuals(seen, lenses, fisheye, rotations, translations, offsets, turns, moves, shifts):
    """Return the residuals (M, 2) px: projection at the time of the image, minus pixel.

    Args:
        seen: `bundle.Observations`.
        lenses, fisheye, rotations, translations, offsets: of the cameras (C, ...).
        turns, moves: (B, 3, 3), (B, 3) m, world from target.
        shifts: (V,) s, time shift of each view.
    """
    out = np.empty((len(seen.pixels), 2))
    pixel = np.empty(2)
    change, turned, moved_to = np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    for v in range(len(seen.cameras)):
        c, b = seen.cameras[v], seen.targets[v]
        late = seen.delays[v] + offsets[c] + shifts[v]
        _move_on(turns[b], moves[b], seen.twists[b], late, change, turned, moved_to)
        for m in range(seen.starts[v], seen.starts[v + 1]):
            x, y, z = _rotated(turned, seen.points[m])
            x, y, z = x + moved_to[0], y + moved_to[1], z + moved_to[2]
            if project(lenses[c], fisheye[c], rotations[c], translations[c], x, y, z, pixel):
                for i in range(2):
                    out[m, i] = pixel[i] - seen.pixels[m, i]
            else:
                out[m, 0] = out[m, 1] = BEHIND
    return out


@inlined
def _by_target(by_point, change, dx, dy, dz, row, at):
    """Write the derivatives by a target's pose to six entries of a row.

    Args:
        by_point: (3,) derivatives by the world point.
        change: (3, 3) rotation since the instant.
        dx, dy, dz: m, point relative to the target's origin, rotated to the world at the instant.
    """
    p = by_point[0] * change[0, 0] + by_point[1] * change[1, 0] + by_point[2] * change[2, 0]
    q = by_point[0] * change[0, 1] + by_point[1] * change[1, 1] + by_point[2] * change[2, 1]
    r = by_point[0] * change[0, 2] + by_point[1] * change[1, 2] + by_point[2] * change[2, 2]
    row[at], row[at + 1], row[at + 2] = r * dy - q * dz, p * dz - r * dx, q * dx - p * dy
    row[at + 3], row[at + 4], row[at + 5] = by_point[0], by_point[1], by_point[2]


@_jit
def twists_of(seen, speeds, lenses, fisheye, rotations, translations, turns, moves):
    """Return the motion (B, 6) rad/s, m/s of each target that fits the image velocities of its views best.

    Args:
        speeds: (M, 2) px/s.
    """
    out = np.zeros((len(turns), POSE))
    pixel, by_camera, by_point = np.empty(2), np.empty((2, OFFSET)), np.empty((2, 3))
    row, still = np.empty(POSE), np.eye(3)
    for b in range(len(turns)):
        square, right = LEAST * np.eye(POSE), np.zeros(POSE)
        for v in range(seen.firsts[b], seen.firsts[b + 1]):
            c = seen.cameras[v]
            for m in range(seen.starts[v], seen.starts[v + 1]):
                dx, dy, dz = _rotated(turns[b], seen.points[m])
                x, y, z = dx + moves[b, 0], dy + moves[b, 1], dz + moves[b, 2]
                if derivatives(
                    lenses[c], fisheye[c], rotations[c], translations[c], x, y, z, pixel, by_camera, by_point
                ):
                    for i in range(2):
                        _by_target(by_point[i], still, dx, dy, dz, row, 0)
                        for p in range(POSE):
                            right[p] += row[p] * speeds[m, i]
                            for q in range(POSE):
                                square[p, q] += row[p] * row[q]
        out[b] = np.linalg.solve(square, right)
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
        shift: (V, VIEW + 2), of each view: coefficients of its unknowns, weight and right-hand side of its
            shift.
    """
    views, cameras, blocks = len(seen.cameras), len(lenses), len(turns)
    own, own_right = np.zeros((cameras, CAMERA, CAMERA)), np.zeros((cameras, CAMERA))
    cross = np.zeros((views, CAMERA, POSE))
    target, target_right = np.zeros((blocks, POSE, POSE)), np.zeros((blocks, POSE))
    shift = np.zeros((views, VIEW + 2))
    pixel, by_camera, by_point = np.empty(2), np.empty((2, OFFSET)), np.empty((2, 3))
    change, turned, moved_to = np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    row = np.empty((2, VIEW))
    square, right = np.empty((VIEW, VIEW)), np.empty(VIEW)
    for v in range(views):
        c, b = seen.cameras[v], seen.targets[v]
        late, twist = seen.delays[v] + offsets[c] + shifts[v], seen.twists[b]
        _move_on(turns[b], moves[b], twist, late, change, turned, moved_to)
        square[:], right[:] = 0.0, 0.0
        side, weight_of_shift, right_of_shift = shift[v, :VIEW], 0.0, 0.0
        for m in range(seen.starts[v], seen.starts[v + 1]):
            dx, dy, dz = _rotated(turns[b], seen.points[m])
            ex, ey, ez = _rotated(turned, seen.points[m])
            x, y, z = ex + moved_to[0], ey + moved_to[1], ez + moved_to[2]
            if not derivatives(
                lenses[c], fisheye[c], rotations[c], translations[c], x, y, z, pixel, by_camera, by_point
            ):
                continue
            rx, ry = pixel[0] - seen.pixels[m, 0], pixel[1] - seen.pixels[m, 1]
            weight = 1.0 / (seen.variances[m] * _growth((rx * rx + ry * ry) / seen.variances[m], scale))
            vx = twist[1] * ez - twist[2] * ey + twist[3]
            vy = twist[2] * ex - twist[0] * ez + twist[4]
            vz = twist[0] * ey - twist[1] * ex + twist[5]
            for i in range(2):
                row[i, :OFFSET] = by_camera[i]
                row[i, OFFSET] = by_point[i, 0] * vx + by_point[i, 1] * vy + by_point[i, 2] * vz
                _by_target(by_point[i], change, dx, dy, dz, row[i], CAMERA)
            sx, sy = row[0, OFFSET], row[1, OFFSET]
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
def reduce_to_cameras(cameras, starts, index, inverse, cross, target_right, reduced, right):
    """Subtract the eliminated targets from the normal equations of the cameras (Schur complement), in place.

    Args:
        cameras: (V,) camera of each view. starts: (B + 1,) first view of each target.
        index: (C, CAMERA) row of each unknown in `reduced`, ascending without gaps; -1 = fixed.
        inverse: (B, 6, 6) inverse information of the targets, 0 in rows of fixed unknowns.
        cross: (V, CAMERA, 6), target_right: (B, 6), as returned by `linearise`.
        reduced: (N, N), changed; only its lower triangle is complete. right: (N,), changed.
    """
    gain, counts = np.empty((CAMERA, POSE)), (index >= 0).sum(axis=1)
    most = (starts[1:] - starts[:-1]).max()
    packed = np.empty((most, POSE, CAMERA))  # coupling of the views of a target by free unknowns
    for b in range(len(starts) - 1):
        own = inverse[b]
        first, last = 0, POSE  # a free point has no rotation
        while first < POSE and own[first, first] == 0.0:
            first += 1
        for v in range(starts[b], starts[b + 1]):
            n = 0
            for p in range(CAMERA):
                if index[cameras[v], p] >= 0:
                    for k in range(POSE):
                        packed[v - starts[b], k, n] = cross[v, p, k]
                    n += 1
        for v in range(starts[b], starts[b + 1]):
            c = cameras[v]
            row, rows = index[c].max() + 1 - counts[c], counts[c]
            for p in range(rows):
                for k in range(first, last):
                    total = 0.0
                    for j in range(first, last):
                        total += packed[v - starts[b], j, p] * own[j, k]
                    gain[p, k] = total
                    right[row + p] -= total * target_right[b, k]
            for w in range(starts[b], starts[b + 1]):
                d = cameras[w]
                if d > c:
                    continue
                column, columns, other = index[d].max() + 1 - counts[d], counts[d], packed[w - starts[b]]
                for p in range(rows):
                    for k in range(first, last):
                        factor = gain[p, k]
                        for q in range(columns):
                            reduced[row + p, column + q] -= factor * other[k, q]


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
