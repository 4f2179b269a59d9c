"""The joints of one body together, from what is known of it and the rays of a few views; compiled.

A joint needs two views to be solved alone. With bones of known length a single ray places it. All joints of a
person are estimated together, as the maximum a posteriori under

* where joints are known to be, each with its information: solved by views that agree, or predicted;
* vectors along bones, where these are predicted: parts that no view shows move with the rest;
* lengths of bones;
* how far the trunk as a whole can have moved up or down: with the rays that tells depth;
* the rays of the joints that are seen, with Cauchy weights.

Gauss-Newton on the normal equations of all joints; covariances are blocks of the inverse of their matrix.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.domain import SkeletonModel
from panoptic_ros.geometry.robust import noise_growth
from panoptic_ros.geometry.symmetric import factor, solve_lower, solve_upper
from panoptic_ros.kernels import njit
from panoptic_ros.solving.scene import MIN_DEPTH, Observations, seen_at
from panoptic_ros.solving.triangulation import SETTLED, intersect, viewing_ray

Array = np.ndarray

TRUSTED = 2.0  # standard deviations; scale of the Cauchy weights of rays
STEPS = 6  # of Gauss-Newton, at most
WIDEST_GAP = 0.25  # m, between two rays that may be of one joint
CLOSE = 0.15  # m, between joints of a head, whose bones have no other side
STRETCH = 1.3  # a ray may pass a neighbour this much farther away than the bone is long
OUTWARDS = 2  # bones along which places are begun


class Body(NamedTuple):
    """bones (B, 2) of the skeleton; others (B,), the same bone of the other side, -1 = none; trunk (K,), its
    root and the joints next to it.
    """

    bones: Array
    others: Array
    trunk: Array

    @classmethod
    def of(cls, skeleton: SkeletonModel) -> Body:
        """That of a skeleton."""
        bones, mirror = list(skeleton.bones), skeleton.mirror
        pairs = [(mirror[a], mirror[b]) for a, b in bones]
        others = [bones.index(q) if q != p and q in bones else -1 for p, q in zip(bones, pairs)]
        trunk = {skeleton.root, *(child for parent, child in bones if parent == skeleton.root)}
        return cls(
            np.array(bones, np.int64).reshape(-1, 2), np.array(others, np.int64), np.array(sorted(trunk))
        )


class Known(NamedTuple):
    """What is known of a person besides images.

    places (J, 3) m, NaN = nothing; information (J, 3, 3) 1/m^2 of them; vectors (B, 3) m along bones and
    their standard deviations slack (B,) m; lengths (B,) m, NaN = not known, and their standard deviations
    spreads (B,) m; still (J, 3) m where joints were a moment ago, up (3,), and rise m, the standard deviation
    of how far the trunk moves upwards. What is not known of vectors and rise has infinite deviations.
    """

    places: Array
    information: Array
    vectors: Array
    slack: Array
    lengths: Array
    spreads: Array
    still: Array
    up: Array
    rise: float


class Rays(NamedTuple):
    """What the views show of a person's J joints.

    member (V,) the 2D person, -1 = none; source (V, J) which of its joints stands for joint j; shifts (J, 3)
    m/s, velocities; growth (J,), by which the standard deviations of the rays of a joint grow.
    """

    member: Array
    source: Array
    shifts: Array
    growth: Array
    seen: Observations


@njit(cache=True, error_model="numpy")
def begin(known, rays, body, expected):
    """Let the noise of two rays of a joint be no less than their gap, and begin joints anew, in place.

    Two views that dispute a joint do not tell which of them errs. A joint that one view shows begins on its
    ray where the bone to a neighbour is as long as that of the other side, of two such places at that nearer
    to the expected one; without that in their middle, and it may be at either.

    Args:
        expected: (J, 3) m, NaN = none.
    """
    views, joints = rays.source.shape
    own, pair = np.empty((views, 2), np.int64), np.empty(2, np.int64)
    middle, number, first = np.empty(3), np.zeros(joints, np.int64), np.zeros(joints, np.int64)
    for j in range(joints):
        for v in range(views):
            own[v, 0], own[v, 1] = rays.member[v], rays.source[v, j]
            if own[v, 0] >= 0 and rays.seen.precision[own[v, 0], own[v, 1]] > 0.0:
                pair[min(number[j], 1)] = first[j] = v
                number[j] += 1
        if number[j] == 2 and intersect(pair[0], pair[1], own, rays.seen, middle):
            gap = residual = 0.0
            for k in range(2):
                du, dw, _, _, depth = _look(middle, j, pair[k], rays)
                miss = np.sqrt(du * du + dw * dw)
                gap += miss * depth
                residual = max(residual, miss * rays.seen.precision[own[pair[k], 0], own[pair[k], 1]])
            if gap <= WIDEST_GAP:
                rays.growth[j] = max(rays.growth[j], residual)
                if np.isnan(known.places[j, 0]):
                    for i in range(3):
                        known.places[j, i] = middle[i]
    for b in range(len(body.bones)):
        if body.others[b] >= 0 and np.isnan(known.lengths[b]):
            (start, end), square = body.bones[body.others[b]], 0.0
            for i in range(3):
                square += (known.places[end, i] - known.places[start, i]) ** 2
            known.lengths[b] = np.sqrt(square)
    for step in range(2 * OUTWARDS):  # bones of known length first
        for b in range(len(body.bones)):
            for k in range(2 if np.isfinite(known.lengths[b]) == (step % 2 == 0) else 0):
                j, end = body.bones[b, k], body.bones[b, 1 - k]
                if number[j] == 1 and np.isnan(known.places[j, 0]) and np.isfinite(known.places[end, 0]):
                    _begin_beside(j, first[j], known.places[end], b, known, rays, expected)


@njit(cache=True, error_model="numpy")
def _begin_beside(j, v, end, b, known, rays, expected):
    """Put joint j, in place, where the ray of view v passes the other end (3,) m of bone b, if it is near."""
    ray, centre, place = np.empty(3), np.empty(3), np.empty(3)
    viewing_ray(rays.seen.cams, v, rays.seen.plane[rays.member[v], rays.source[v, j]], ray, centre)
    depth = passing = 0.0
    for i in range(3):
        depth += (end[i] - centre[i]) * ray[i]
    for i in range(3):
        place[i] = centre[i] + depth * ray[i]
        passing += (place[i] - end[i]) ** 2
    length = known.lengths[b]
    reach = STRETCH * length if np.isfinite(length) else CLOSE
    if depth > 0.0 and passing < reach**2:
        half, away = np.sqrt(max(length**2 - passing, 0.0)) if np.isfinite(length) else CLOSE, 0.0
        if np.isfinite(expected[j, 0]) and np.isfinite(length):
            for i in range(3):
                away += (expected[j, i] - place[i]) * ray[i]
            away = half if away > 0.0 else -half
            half = 0.0
        for i in range(3):
            known.places[j, i] = place[i] + away * ray[i]
            known.information[j, i, i] = 1.0 / (half**2 + known.spreads[b] ** 2)


@njit(cache=True, error_model="numpy")
def estimate(known, rays, body):
    """Places (J, 3) m, covariances (J, 3, 3) m^2, NaN = not known; residuals (V, J) in deviations."""
    x = known.places.copy()
    joints = len(x)
    normal, step = np.zeros((3 * joints, 3 * joints)), np.zeros(3 * joints)
    begins, residuals = np.zeros(3 * joints, np.int64), np.full(rays.source.shape, np.nan)
    for _ in range(STEPS):
        normal[:], step[:] = 0.0, 0.0
        _add_what_is_known(known, body, x, normal, step)
        _add_rays(rays, x, normal, step, residuals)
        factor(normal, begins)
        solve_lower(normal, begins, step, 0)
        solve_upper(normal, begins, step)
        longest = 0.0
        for j in range(joints):
            square = 0.0
            for i in range(3):
                x[j, i] += step[3 * j + i]
                square += step[3 * j + i] ** 2
            longest = max(longest, square)
        if longest < SETTLED**2:
            break
    covariances, columns = np.full((joints, 3, 3), np.nan), np.empty((3, 3 * joints))
    for j in range(joints):
        if np.isfinite(x[j, 0]):
            for i in range(3):
                columns[i] = 0.0
                columns[i, 3 * j + i] = 1.0
                solve_lower(normal, begins, columns[i], 3 * j + i)
            for i in range(3):
                for k in range(3):
                    covariances[j, i, k] = np.sum(columns[i, 3 * j :] * columns[k, 3 * j :])
    return x, covariances, residuals


@njit(cache=True, error_model="numpy")
def _add_what_is_known(known, body, x, normal, right):
    """Add all but the rays at x (J, 3) m to the normal equations (3J, 3J) and (3J,), in place."""
    for j in range(len(x)):
        for i in range(3):
            if np.isnan(x[j, 0]):
                normal[3 * j + i, 3 * j + i] = 1.0
                continue
            for k in range(3):
                normal[3 * j + i, 3 * j + k] += known.information[j, i, k]
                right[3 * j + i] += known.information[j, i, k] * (known.places[j, k] - x[j, k])
    vector, gap, weight = np.empty(3), np.empty(3), np.empty((3, 3))
    for b in range(len(body.bones)):
        start, end = body.bones[b]
        length = 0.0
        for i in range(3):
            vector[i] = x[end, i] - x[start, i]
            length += vector[i] ** 2
        length = np.sqrt(length)
        if np.isnan(length):
            continue
        stiff, along = 1.0 / known.slack[b] ** 2, 0.0
        if np.isfinite(known.lengths[b]) and length > 1e-3:
            along = 1.0 / known.spreads[b] ** 2
        for i in range(3):
            gap[i] = 0.0
            for k in range(3):
                weight[i, k] = along * vector[i] * vector[k] / length**2
            weight[i, i] += stiff
            gap[i] = stiff * (known.vectors[b, i] - vector[i])
            gap[i] += along * (known.lengths[b] - length) * vector[i] / length if along > 0.0 else 0.0
        for i in range(3):
            right[3 * end + i] += gap[i]
            right[3 * start + i] -= gap[i]
            for k in range(3):
                normal[3 * start + i, 3 * start + k] += weight[i, k]
                normal[3 * end + i, 3 * end + k] += weight[i, k]
                normal[3 * start + i, 3 * end + k] -= weight[i, k]
                normal[3 * end + i, 3 * start + k] -= weight[i, k]
    _add_trunk(known, body, x, normal, right)


@njit(cache=True, error_model="numpy")
def _add_trunk(known, body, x, normal, right):
    """Add that the trunk as a whole hardly rises or sinks, in place."""
    count, risen = 0, 0.0
    for j in body.trunk:
        if np.isfinite(x[j, 0] - known.still[j, 0]):
            count += 1
            for i in range(3):
                risen += known.up[i] * (x[j, i] - known.still[j, i])
    if not count or np.isinf(known.rise):
        return
    weight = 1.0 / (known.rise * count) ** 2
    for j in body.trunk:
        for i in range(3 if np.isfinite(x[j, 0] - known.still[j, 0]) else 0):
            right[3 * j + i] -= weight * known.up[i] * risen
            for m in body.trunk:
                for k in range(3 if np.isfinite(x[m, 0] - known.still[m, 0]) else 0):
                    normal[3 * j + i, 3 * m + k] += weight * known.up[i] * known.up[k]


@njit(cache=True, error_model="numpy")
def _add_rays(rays, x, normal, right, residuals):
    """Add the rays at x (J, 3) m, with Cauchy weights, and write their residuals (V, J), in place."""
    slopes = np.empty((2, 3))
    for v, j in np.ndindex(rays.source.shape):
        d, s = rays.member[v], rays.source[v, j]
        if d < 0 or not rays.seen.precision[d, s] > 0.0 or np.isnan(x[j, 0]):
            continue
        du, dw, u, w, depth = _look(x[j], j, v, rays)
        information = (rays.seen.precision[d, s] / rays.growth[j]) ** 2
        squared = (du * du + dw * dw) * information
        residuals[v, j] = np.sqrt(squared)
        if depth <= MIN_DEPTH:
            continue
        weight = information / noise_growth(squared, TRUSTED)
        r = rays.seen.cams.rotations[v]
        for i in range(3):
            slopes[0, i] = (r[0, i] - u * r[2, i]) / depth
            slopes[1, i] = (r[1, i] - w * r[2, i]) / depth
        for i in range(3):
            right[3 * j + i] += weight * (slopes[0, i] * du + slopes[1, i] * dw)
            for k in range(3):
                cross = slopes[0, i] * slopes[0, k] + slopes[1, i] * slopes[1, k]
                normal[3 * j + i, 3 * j + k] += weight * cross


@njit(cache=True, error_model="numpy")
def _look(x, j, v, rays):
    """What view v shows of joint j less where it sees x (3,) m, on the plane; where that is; its depth m."""
    seen = rays.seen.plane[rays.member[v], rays.source[v, j]]
    u, w, depth = seen_at(rays.seen.cams, v, x, rays.shifts[j])
    return seen[0] - u, seen[1] - w, u, w, depth
