"""Triangulation of points: linear, from two rays, and by Gauss-Newton on the reprojection error.

`spread_views` chooses views that are far from each other.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.geometry.robust import noise_growth
from panoptic_ros.geometry.symmetric import solve_symmetric
from panoptic_ros.kernels import njit
from panoptic_ros.solving.scene import MIN_DEPTH

Array = np.ndarray

MAX_STEP = 0.5  # m, greatest length of one step
# m; a step shorter than this ends the iteration, or the part of the iteration without the gate
SETTLED = 1e-5
FEW = 3  # views, maximum number for which the gate is wider: the normal gate would soon leave no view
FEW_FACTOR = 1.25  # factor on the gate with few views
# Columns of a table of observations. The first twelve hold cam_from_world: the rotation, row by row, and the
# translation, which includes the joint's motion up to the timestamp of the view. Then follow the point on the
# normalised plane, its information (1 / variance), and the view.
X, Y, INFORMATION, VIEW = 12, 13, 14, 15
TABLE = 16


class SolverRules(NamedTuple):
    """Weights and limits of observations; see `AssemblyConfig`.

    Args:
        truncation: Residual, in standard deviations, from which the cost of an observation stays constant.
        cauchy: Scale of the Cauchy weights, in standard deviations.
        gate: Greatest residual of a view that is used, in standard deviations.
        foreign_penalty: Cost of using a joint of another person's 2D pose, in squared standard deviations.
        max_pairs: Greatest number of pairs of views that are tried as a start.
    """

    truncation: float
    cauchy: float
    gate: float
    foreign_penalty: float
    max_pairs: int


class IterationLimit(NamedTuple):
    """Limit of an iteration.

    Args:
        most: maximum number of steps.
        gated: whether the last step and the final evaluation leave out residuals beyond the gate.
    """

    most: int
    gated: bool


class PointSolution(NamedTuple):
    """Arrays that `refine_point` writes.

    Args:
        normal: (3, 3) 1/m^2, normal matrix, lower triangle.
        residuals: (V,) in standard deviations, -1 where a view has no pick or is beyond the gate.
        table: (V, TABLE) work array, see `_tabulate`.
    """

    normal: Array
    residuals: Array
    table: Array


@njit(cache=True, error_model="numpy", nogil=True)
def spread_views(centres, used, most):
    """Return up to `most` of the used views (V,) that are far from each other, as a mask.

    Args:
        centres: (V, 3) m, optical centres of the cameras.
        used: (V,) bool.
    """
    if used.sum() <= most:
        return used
    distance, picked = np.where(used, np.inf, -1.0), np.zeros(len(used), np.bool_)
    for _ in range(most):
        last = distance.argmax()
        picked[last] = True
        for v in range(len(used)):
            square = 0.0
            for axis in range(3):
                square += (centres[v, axis] - centres[last, axis]) ** 2
            distance[v] = min(distance[v], square)
    return picked


@njit(cache=True, error_model="numpy", nogil=True)
def middle_of_cameras(member, rotations, translations):
    """Return the mean centre (3,) m, world, of the cameras that have a 2D pose; 0 if none has.

    Args:
        member: (V,) row of the 2D pose of each view, -1 = none.
        rotations, translations: (V, 3, 3) and (V, 3) m, cam_from_world.
    """
    middle, count = np.zeros(3), 0
    for v in range(len(member)):
        if member[v] >= 0:
            count += 1
            for i in range(3):
                for k in range(3):
                    middle[i] -= rotations[v, k, i] * translations[v, k]
    return middle / max(count, 1)


@njit(cache=True, error_model="numpy")
def triangulate_linear(member, mirrored, seen, mirror):
    """Return the joints (J, 3) m, world, of 2D poses by linear triangulation; NaN with fewer than two views.

    The equations are relative to the mean centre of the cameras. So the damping pulls towards that centre,
    wherever the world has its origin.

    Args:
        member: (V,) row of the 2D pose of each view, -1 = none.
        mirrored: (V,) whether left and right of that 2D pose are exchanged.
        seen: `SceneObservations`.
        mirror: (J,) joint on the other side.
    """
    plane, precision, joints = seen.plane, seen.precision, len(mirror)
    rotations, translations, _ = seen.cams
    points = np.full((joints, 3), np.nan)
    row, middle = np.empty(3), middle_of_cameras(member, rotations, translations)
    moved = np.empty((len(member), 3))
    for v in range(len(member)):
        for i in range(3):
            moved[v, i] = translations[v, i]
            for k in range(3):
                moved[v, i] += rotations[v, i, k] * middle[k]
    for j in range(joints):
        normal, right = np.zeros((3, 3)), np.zeros(3)
        count = 0
        for v in range(len(member)):
            d = member[v]
            if d < 0:
                continue
            s = mirror[j] if mirrored[v] else j
            weight = precision[d, s]
            if weight <= 0.0:
                continue
            count += 1
            for k in range(2):
                for i in range(3):
                    row[i] = weight * (plane[d, s, k] * rotations[v, 2, i] - rotations[v, k, i])
                offset = weight * (moved[v, k] - plane[d, s, k] * moved[v, 2])
                for i in range(3):
                    right[i] += row[i] * offset
                    for m in range(i + 1):
                        normal[i, m] += row[i] * row[m]
        if count < 2:
            continue
        damping = 1e-9 * max(normal[0, 0] + normal[1, 1] + normal[2, 2], 1e-9)
        lower = (
            normal[0, 0] + damping,
            normal[1, 0],
            normal[1, 1] + damping,
            normal[2, 0],
            normal[2, 1],
            normal[2, 2] + damping,
        )
        good, a, b, c = solve_symmetric(lower, (right[0], right[1], right[2]))
        if good:
            points[j, 0], points[j, 1], points[j, 2] = a + middle[0], b + middle[1], c + middle[2]
    return points


@njit(cache=True, error_model="numpy")
def viewing_ray(cams, v, point, ray, centre):
    """Write the unit direction of a ray to `ray` (3,), and its camera centre to `centre` (3,) m, world.

    Args:
        point: (2,) point of view v on the plane at 1 m.
        ray, centre: outputs.
    """
    r, length = cams.rotations[v], 0.0
    for i in range(3):
        ray[i] = r[0, i] * point[0] + r[1, i] * point[1] + r[2, i]
        length += ray[i] ** 2
        centre[i] = 0.0
        for m in range(3):
            centre[i] -= r[m, i] * cams.translations[v, m]
    length = np.sqrt(length)
    for i in range(3):
        ray[i] /= length


@njit(cache=True, error_model="numpy")
def intersect(first, second, own, seen, x):
    """Write the middle of the shortest connection of two rays to x (3,) m, world.

    Args:
        first, second: views of the rays.
        own: (V, 2) row of the 2D pose of each view and index of its joint.

    Returns:
        False if the rays are nearly parallel, or meet behind a camera or closer than MIN_DEPTH; x is then
        unchanged.
    """
    rays, centres = np.empty((2, 3)), np.empty((2, 3))
    for k in range(2):
        v = first if k == 0 else second
        viewing_ray(seen.cams, v, seen.plane[own[v, 0], own[v, 1]], rays[k], centres[k])
    cosine = along_a = along_b = 0.0
    for i in range(3):
        offset = centres[1, i] - centres[0, i]
        cosine += rays[0, i] * rays[1, i]
        along_a += rays[0, i] * offset
        along_b += rays[1, i] * offset
    sine = 1.0 - cosine * cosine
    if sine < 1e-4:
        return False
    a = (along_a - cosine * along_b) / sine
    b = (cosine * along_a - along_b) / sine
    if a < MIN_DEPTH or b < MIN_DEPTH:
        return False
    for i in range(3):
        x[i] = 0.5 * (centres[0, i] + a * rays[0, i] + centres[1, i] + b * rays[1, i])
    return True


@njit(cache=True, error_model="numpy")
def refine_point(x, shift, picks, seen, rules, limit, result):
    """Refine a point by Gauss-Newton with Cauchy weights and a gate, and write it to `x`.

    Args:
        x: (3,) m, world, start; becomes the refined point.
        shift: (3,) m/s, velocity of the point.
        picks: (V, 2) row of the 2D pose and index of its joint, -1 = none.
        seen: `SceneObservations`.
        rules: `SolverRules`.
        limit: `IterationLimit`.
        result: `PointSolution`.

    Returns:
        the number of views in the last normal matrix.
    """
    normal, residuals, table = result
    steps, gated = limit
    used = _tabulate(shift, picks, seen, residuals, table)
    gate = (rules.gate * (1.0 if used > FEW else FEW_FACTOR)) ** 2
    x0, x1, x2 = x[0], x[1], x[2]
    count, step = 0, -1
    while step < steps:
        step += 1
        n00 = n10 = n11 = n20 = n21 = n22 = b0 = b1 = b2 = 0.0
        count = 0
        test = gated and step >= steps - 1
        for k in range(used):
            row = table[k]
            z = row[6] * x0 + row[7] * x1 + row[8] * x2 + row[11]
            view = int(row[VIEW])
            residuals[view] = -1.0
            if z < MIN_DEPTH:
                continue
            inverse = 1.0 / z
            u = (row[0] * x0 + row[1] * x1 + row[2] * x2 + row[9]) * inverse
            w = (row[3] * x0 + row[4] * x1 + row[5] * x2 + row[10]) * inverse
            du, dw = row[X] - u, row[Y] - w
            squared = (du * du + dw * dw) * row[INFORMATION]
            if test and squared > gate:
                continue
            residuals[view] = squared
            count += 1
            weight = row[INFORMATION] / noise_growth(squared, rules.cauchy) * inverse
            g0, g1, g2 = row[0] - u * row[6], row[1] - u * row[7], row[2] - u * row[8]
            h0, h1, h2 = row[3] - w * row[6], row[4] - w * row[7], row[5] - w * row[8]
            b0 += weight * (g0 * du + h0 * dw)
            b1 += weight * (g1 * du + h1 * dw)
            b2 += weight * (g2 * du + h2 * dw)
            weight *= inverse
            n00 += weight * (g0 * g0 + h0 * h0)
            n10 += weight * (g1 * g0 + h1 * h0)
            n11 += weight * (g1 * g1 + h1 * h1)
            n20 += weight * (g2 * g0 + h2 * h0)
            n21 += weight * (g2 * g1 + h2 * h1)
            n22 += weight * (g2 * g2 + h2 * h2)
        if step == steps or count < 2:
            break
        good, s0, s1, s2 = newton_step((n00, n10, n11, n20, n21, n22), (b0, b1, b2))
        if not good:
            count = 0
            break
        x0, x1, x2 = x0 + s0, x1 + s1, x2 + s2
        if not test and s0 * s0 + s1 * s1 + s2 * s2 < SETTLED * SETTLED:
            step = max(step, steps - 2 if gated else steps - 1)
    x[0], x[1], x[2] = x0, x1, x2
    normal[:] = 0.0
    normal[0, 0], normal[1, 0], normal[1, 1] = n00, n10, n11
    normal[2, 0], normal[2, 1], normal[2, 2] = n20, n21, n22
    _take_roots(residuals, table[:used, VIEW])
    return count


@njit(cache=True, error_model="numpy")
def _tabulate(shift, picks, seen, residuals, table):
    """Write the picked observations to the rows of the table, and return their number."""
    rotations, translations, _ = seen.cams
    used = 0
    for v in range(len(picks)):
        residuals[v] = -1.0
        d, s = picks[v, 0], picks[v, 1]
        if d < 0:
            continue
        for i in range(3):
            moved = translations[v, i]
            for k in range(3):
                table[used, 3 * i + k] = rotations[v, i, k]
                moved += rotations[v, i, k] * shift[k] * seen.delays[d, s]
            table[used, 9 + i] = moved
        table[used, X], table[used, Y] = seen.plane[d, s, 0], seen.plane[d, s, 1]
        table[used, INFORMATION] = seen.precision[d, s] ** 2
        table[used, VIEW] = v
        used += 1
    return used


@njit(cache=True, error_model="numpy")
def _take_roots(residuals, views):
    """Replace the squared residuals of these views in `residuals` by their roots."""
    for k in range(len(views)):
        view = int(views[k])
        if residuals[view] >= 0.0:
            residuals[view] = np.sqrt(residuals[view])


@njit(cache=True, error_model="numpy")
def newton_step(lower, right):
    """Return whether the step exists, and its three components in m, damped and at most MAX_STEP long.

    Args:
        lower, right: see `solve_symmetric`.
    """
    n00, n10, n11, n20, n21, n22 = lower
    damping = 1e-9 * (n00 + n11 + n22)
    damped = (n00 + damping, n10, n11 + damping, n20, n21, n22 + damping)
    good, s0, s1, s2 = solve_symmetric(damped, right)
    length = np.sqrt(s0 * s0 + s1 * s1 + s2 * s2)
    scale = 1.0 if length < MAX_STEP else MAX_STEP / length
    return good, scale * s0, scale * s1, scale * s2
