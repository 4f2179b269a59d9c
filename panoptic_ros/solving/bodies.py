"""Joint estimation of all joints of one person from prior knowledge and the rays of a few views; compiled.

A joint that is solved alone needs two views. With a bone of known length, one view is enough. This module
estimates all joints of a person together. The result is the maximum a posteriori estimate under these terms:

* positions of joints with their information matrices: solved by views that agree, or predicted;
* vectors along bones, where they are predicted: parts that no view sees then move with the rest;
* bone lengths;
* the vertical motion of the trunk as a whole: together with the rays it determines depth;
* the rays of the observed joints, with Cauchy weights.

The solver is Gauss-Newton on the normal equations of all joints. Covariances are blocks of the inverse of the
normal matrix.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.domain import SkeletonModel
from panoptic_ros.geometry.robust import noise_growth
from panoptic_ros.geometry.symmetric import factor, solve_lower, solve_upper
from panoptic_ros.kernels import njit
from panoptic_ros.solving.scene import MIN_DEPTH, SceneObservations, seen_at
from panoptic_ros.solving.triangulation import SETTLED, intersect, viewing_ray

Array = np.ndarray

TRUSTED = 2.0  # standard deviations, scale of the Cauchy weights of rays
STEPS = 6  # maximum number of Gauss-Newton steps
WIDEST_GAP = 0.25  # m, largest distance between two rays that may belong to one joint
CLOSE = 0.15  # m, used for unknown bone lengths: bones of the head have no counterpart on the other side
STRETCH = 1.3  # bone lengths, largest distance at which a ray may pass the neighbouring joint
OUTWARDS = 2  # passes over the bones that start joints beside neighbours with a position


class SkeletonArrays(NamedTuple):
    """Bones and trunk of a skeleton, as arrays for kernels.

    Args:
        bones: (B, 2) joints at the two ends of each bone.
        others: (B,) index of the same bone on the other side, -1 = none.
        trunk: (K,) the root joint and its child joints.
    """

    bones: Array
    others: Array
    trunk: Array

    @classmethod
    def of(cls, skeleton: SkeletonModel) -> SkeletonArrays:
        """Return the arrays of a skeleton."""
        bones, mirror = list(skeleton.bones), skeleton.mirror
        pairs = [(mirror[a], mirror[b]) for a, b in bones]
        others = [bones.index(q) if q != p and q in bones else -1 for p, q in zip(bones, pairs)]
        trunk = {skeleton.root, *(child for parent, child in bones if parent == skeleton.root)}
        return cls(
            np.array(bones, np.int64).reshape(-1, 2), np.array(others, np.int64), np.array(sorted(trunk))
        )


class PersonPrior(NamedTuple):
    """Prior knowledge about one person, without the images.

    Args:
        places: (J, 3) m, world, prior positions of the joints, NaN = unknown.
        information: (J, 3, 3) 1/m^2, inverse covariances of `places`.
        vectors: (B, 3) m, world, predicted vectors along the bones.
        slack: (B,) m, standard deviations of `vectors`, infinite where they are unknown.
        lengths: (B,) m, bone lengths, NaN = unknown.
        spreads: (B,) m, standard deviations of `lengths`.
        still: (J, 3) m, world, positions of the joints a moment ago, reference of `rise`.
        up: (3,) unit vector, upward direction in the world.
        rise: m, standard deviation of the trunk's mean vertical displacement since `still`; infinite if
            unknown.
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


class PersonRays(NamedTuple):
    """Observations of one person's J joints in V views.

    Args:
        member: (V,) row of the person's 2D pose in each view, -1 = none.
        source: (V, J) joint of that 2D pose that stands for joint j.
        shifts: (J, 3) m/s, velocities of the joints.
        growth: (J,) factor on the standard deviations of all rays of a joint.
        seen: All 2D poses of the instant.
    """

    member: Array
    source: Array
    shifts: Array
    growth: Array
    seen: SceneObservations


@njit(cache=True, error_model="numpy")
def begin(known, rays, body, expected):
    """Write start positions of joints without one to `known`, and larger noise of disputed joints to `rays`.

    If two views dispute a joint, it is unclear which view is wrong. So the noise of both rays grows until it
    covers their gap, and the joint starts midway between them. Two rays more than WIDEST_GAP apart start
    no joint.

    A joint that one view observes starts on its ray, beside a neighbouring joint. The distance to the
    neighbour is the length of the bone, which is known or taken from the other side. Two points of the ray
    have that distance, and the one nearer to the expected position is used. Without an expected position, the
    joint starts midway between the two points, with a standard deviation that covers both points. If no
    length is known, it starts at the point of the ray nearest to the neighbour, with a standard deviation of
    about CLOSE.

    Args:
        known: `PersonPrior`; positions, information and bone lengths are added.
        rays: `PersonRays`; `growth` increases.
        body: `SkeletonArrays`.
        expected: (J, 3) m, world, NaN = none.
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
    for step in range(2 * OUTWARDS):  # in each pass, bones of known length come first
        for b in range(len(body.bones)):
            for k in range(2 if np.isfinite(known.lengths[b]) == (step % 2 == 0) else 0):
                j, end = body.bones[b, k], body.bones[b, 1 - k]
                if number[j] == 1 and np.isnan(known.places[j, 0]) and np.isfinite(known.places[end, 0]):
                    _begin_beside(j, first[j], known.places[end], b, known, rays, expected)


@njit(cache=True, error_model="numpy")
def _begin_beside(j, v, end, b, known, rays, expected):
    """Write a start position of joint j to `known`: on the ray of view v, near the other end of bone b.

    The joint stays unknown if the other end is behind the camera. It also stays unknown if the ray passes
    that end at more than STRETCH bone lengths. If the length is unknown, the limit is CLOSE.

    Args:
        end: (3,) m, world, position of the other end.
        known, rays, expected: See `begin`.
    """
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
def estimate(known, rays, body, wanted):
    """Estimate all joints of one person by Gauss-Newton.

    Args:
        known: `PersonPrior`, after `begin` if joints without a prior position shall be placed.
        rays: `PersonRays`.
        body: `SkeletonArrays`.
        wanted: (J,) whether the covariance of a joint is computed; it takes as long as a step for all joints.

    Returns:
        positions: (J, 3) m, world, NaN = unknown.
        covariances: (J, 3, 3) m^2, NaN = unknown or not wanted.
        residuals: (V, J) in standard deviations, NaN where no ray was used.
    """
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
        if wanted[j] and np.isfinite(x[j, 0]):
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
    """Add all terms except the rays to the normal equations `normal` and `right`.

    Args:
        x: (J, 3) m, world, positions at which the terms are linearised; NaN = unknown.
        normal: (3J, 3J) 1/m^2, normal matrix.
        right: (3J,) 1/m, right-hand side.
    """
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
    """Add the term that the trunk as a whole hardly moves up or down to the normal equations.

    The term is one constraint on the mean over the trunk's joints, not one per joint. Arguments: see
    `_add_what_is_known`.
    """
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
    """Add the rays with Cauchy weights to the normal equations, and write their residuals to `residuals`.

    Args:
        x, normal, right: See `_add_what_is_known`.
        residuals: (V, J) output, in standard deviations; entries without a ray stay unchanged.
    """
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
    """Return the residual of joint j in view v, its projection and its depth.

    Args:
        x: (3,) m, world, position of the joint.

    Returns:
        du, dw: observed minus projected point, on the plane at 1 m.
        u, w: projected point, on the plane at 1 m.
        depth: m.
    """
    d, s = rays.member[v], rays.source[v, j]
    u, w, depth = seen_at(rays.seen.cams, v, x, rays.shifts[j], rays.seen.delays[d, s])
    return rays.seen.plane[d, s, 0] - u, rays.seen.plane[d, s, 1] - w, u, w, depth
