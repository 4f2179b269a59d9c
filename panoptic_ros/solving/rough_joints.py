"""A robust first estimate of the joints of associated people, with which voting explains score maps away."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from panoptic_ros.domain import AssociationSet, SkeletonModel
from panoptic_ros.kernels import njit
from panoptic_ros.solving.evidence import RigArrays
from panoptic_ros.solving.gauss_newton import INFORMATION, VIEW, X, Y, solve_symmetric
from panoptic_ros.solving.scene import even_precision, scene_of
from panoptic_ros.solving.triangulation import middle_of_cameras
from panoptic_ros.solving.truncation import truncated

Array = np.ndarray

NOISE = 0.005  # standard deviation of a 2D joint, as a share of the image's diagonal
TRUNCATION = 4.0  # standard deviations; gate of 2D joints, and limit of their costs
ROUNDS = 4  # of weighted linear triangulation
MAX_PAIRS = 15  # of views that are tried as candidates where the views disagree
MIN_DEPTH = 0.05  # m


@dataclass(frozen=True, slots=True, eq=False)
class RoughPeople:
    """Joints of P people of one instant: positions (P, J, 3) m, NaN = unknown; velocities (P, J, 3) m/s."""

    positions: Array
    velocities: Array


def rough_people(item: AssociationSet, arrays: RigArrays, skeleton: SkeletonModel) -> RoughPeople:
    """The joints of the people of a set, each where most of its views support it, at least two.

    Nobody is rejected.
    """
    mirror = np.array(skeleton.mirror, np.int64)
    precision = even_precision(item.evidence, arrays, NOISE)
    scene = scene_of(item.detections, item.evidence, precision, mirror, arrays)
    velocities = np.zeros_like(item.places)
    known = item.who >= 0
    velocities[known] = item.prediction.velocities[item.who[known]]
    positions = robust_positions(
        item.places, velocities, item.groups.member, item.groups.mirrored, item.evidence.plane, precision,
        scene.cams, mirror,
    )  # fmt: skip
    for joint, parts in skeleton.derived:
        positions[:, joint] = positions[:, list(parts)].mean(axis=1)
    return RoughPeople(positions, velocities)


@njit(cache=True, error_model="numpy", nogil=True)
def robust_positions(starts, shifts, member, mirrored, plane, precision, cams,
                     mirror):  # fmt: skip
    """Positions (P, J, 3) m of joints with two or more inlier views, NaN elsewhere.

    Candidates are the start (NaN = none), the linear triangulation of all views and, if these leave outliers,
    those of pairs of views. The one of least truncated cost is refined by linear triangulations with Cauchy
    weights, the last two with gating.

    Args:
        starts (P, J, 3) m, shifts (P, J, 3) m/s, member and mirrored (P, V): see `Grouping`.
    """
    rotations, translations, delays = cams
    people, joints = starts.shape[:2]
    views = member.shape[1]
    result = np.full((people, joints, 3), np.nan)
    table, used = np.zeros((views, VIEW)), np.zeros(views, np.bool_)
    for p in range(people):
        middle = middle_of_cameras(member[p], rotations, translations)  # damping draws towards it
        for j in range(joints):
            count = 0
            for v in range(views):
                d = member[p, v]
                s = mirror[j] if mirrored[p, v] else j
                if d < 0 or precision[d, s] <= 0.0:
                    continue
                row = table[count]
                for i in range(3):
                    moved = translations[v, i]
                    for k in range(3):
                        row[3 * i + k] = rotations[v, i, k]
                        moved += rotations[v, i, k] * (middle[k] + shifts[p, j, k] * delays[v])
                    row[9 + i] = moved
                row[X], row[Y], row[INFORMATION] = plane[d, s, 0], plane[d, s, 1], precision[d, s] ** 2
                count += 1
            if count >= 2:
                start = starts[p, j] - middle
                x = _start(table[:count], used, start[0], start[1], start[2])
                for k in range(ROUNDS):
                    x = _weighted(table[:count], x, k >= ROUNDS - 2)
                for i in range(3):
                    result[p, j, i] = x[i] + middle[i]
    return result


@njit(cache=True, error_model="numpy", nogil=True)
def _start(table, used, x0, x1, x2):
    """The candidate of least truncated cost, see `robust_positions`."""
    count = len(table)
    best = (x0, x1, x2)
    least = _cost(table, best)
    used[:count] = True
    x = _linear(table, used)
    cost = _cost(table, x)
    if cost < least:
        best, least = x, cost
    if least < TRUNCATION**2 or count == 2:
        return best
    tried = 0
    for a in range(count):
        for b in range(a + 1, count):
            if tried < MAX_PAIRS:
                tried += 1
                used[:count] = False
                used[a] = used[b] = True
                x = _linear(table, used)
                cost = _cost(table, x)
                if cost < least:
                    best, least = x, cost
    return best


@njit(cache=True, error_model="numpy", nogil=True)
def _squared(row, x):
    """Squared residual in standard deviations of a point in a view, and its depth."""
    z = row[6] * x[0] + row[7] * x[1] + row[8] * x[2] + row[11]
    if not z > MIN_DEPTH:
        return np.inf, z
    u = (row[0] * x[0] + row[1] * x[1] + row[2] * x[2] + row[9]) / z - row[X]
    w = (row[3] * x[0] + row[4] * x[1] + row[5] * x[2] + row[10]) / z - row[Y]
    return (u * u + w * w) * row[INFORMATION], z


@njit(cache=True, error_model="numpy", nogil=True)
def _cost(table, x):
    """Sum of the truncated squared residuals."""
    total = 0.0
    for k in range(len(table)):
        total += truncated(_squared(table[k], x)[0], TRUNCATION**2)
    return total


@njit(cache=True, error_model="numpy", nogil=True)
def _linear(table, used):
    """Linear triangulation of some of the views; NaN if they do not determine it."""
    n00 = n10 = n11 = n20 = n21 = n22 = b0 = b1 = b2 = 0.0
    for k in range(len(table)):
        if not used[k]:
            continue
        row = table[k]
        for i in range(2):
            at, axis = row[X + i], 3 * i
            r0, r1, r2 = at * row[6] - row[axis], at * row[7] - row[axis + 1], at * row[8] - row[axis + 2]
            offset = row[9 + i] - at * row[11]
            n00, n10, n11 = n00 + r0 * r0, n10 + r1 * r0, n11 + r1 * r1
            n20, n21, n22 = n20 + r2 * r0, n21 + r2 * r1, n22 + r2 * r2
            b0, b1, b2 = b0 + r0 * offset, b1 + r1 * offset, b2 + r2 * offset
    damping = 1e-9 * (n00 + n11 + n22)
    good, x0, x1, x2 = solve_symmetric(
        n00 + damping, n10, n11 + damping, n20, n21, n22 + damping, b0, b1, b2
    )
    return (x0, x1, x2) if good else (np.nan, np.nan, np.nan)


@njit(cache=True, error_model="numpy", nogil=True)
def _weighted(table, x, gated):
    """Linear triangulation with Cauchy weights at x; NaN if fewer than two views are left, e.g. by gating."""
    n00 = n10 = n11 = n20 = n21 = n22 = b0 = b1 = b2 = 0.0
    left = 0
    for k in range(len(table)):
        row = table[k]
        squared, z = _squared(row, x)
        if not squared < np.inf or (gated and squared > TRUNCATION**2):
            continue
        left += 1
        weight = row[INFORMATION] / ((1.0 + squared / 4.0) * z * z)
        for i in range(2):
            at, axis = row[X + i], 3 * i
            r0, r1, r2 = at * row[6] - row[axis], at * row[7] - row[axis + 1], at * row[8] - row[axis + 2]
            offset = weight * (row[9 + i] - at * row[11])
            w0, w1, w2 = weight * r0, weight * r1, weight * r2
            n00, n10, n11 = n00 + w0 * r0, n10 + w1 * r0, n11 + w1 * r1
            n20, n21, n22 = n20 + w2 * r0, n21 + w2 * r1, n22 + w2 * r2
            b0, b1, b2 = b0 + r0 * offset, b1 + r1 * offset, b2 + r2 * offset
    damping = 1e-9 * (n00 + n11 + n22)
    good, x0, x1, x2 = solve_symmetric(
        n00 + damping, n10, n11 + damping, n20, n21, n22 + damping, b0, b1, b2
    )
    return (x0, x1, x2) if good and left >= 2 else (np.nan, np.nan, np.nan)
