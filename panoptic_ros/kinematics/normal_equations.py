"""Cost of a pose and its normal equations, without the Jacobian.

For each segment a 6 x 6 matrix and a 6-vector are added up over its targets, for a rotation about the root
and a
translation of the segment. Those of children are added to their parents', as in the composite rigid body
algorithm (Featherstone, Rigid Body Dynamics Algorithms, 2008, section 6.2). A degree of freedom of segment
b then meets one of an ancestor a as X_a^T M_b X_b, where X holds the rotation axes.
"""

from __future__ import annotations

import math

import numpy as np

from panoptic_ros.geometry.chain import Chain, Pose, multiply, place_segments, step_between
from panoptic_ros.geometry.rotations import inverse_left_jacobian, vector_of
from panoptic_ros.kernels import njit
from panoptic_ros.kinematics.targets import (
    Anchor,
    Evidence,
    Floor,
    PointTargets,
    PosePrior,
    TurnTargets,
    ViewTargets,
)

Array = np.ndarray
NEAREST = 0.1  # m before a camera

_jit = njit(cache=True, error_model="numpy", nogil=True)


@_jit
def assemble(
    chain: Chain, pose: Pose, evidence: Evidence, anchor: Anchor, hessian: Array, gradient: Array
) -> float:
    """Cost of a pose; half of its second and first derivatives (D, D) and (D,) into the last two.

    Robust targets enter with the weight that their residuals leave them (Gauss-Newton).
    """
    count = len(chain.parents)
    frames, places = np.empty((count, 3, 3)), np.empty((count, 3))
    place_segments(chain, pose, frames, places)
    matrices, vectors = np.zeros((count, 6, 6)), np.zeros((count, 6))
    cost = _add_views(evidence.views, frames, places, matrices, vectors)
    cost += _add_points(evidence.points, frames, places, matrices, vectors)
    cost += _add_turns(evidence.turns, frames, matrices, vectors)
    cost += _add_floor(evidence.floor, places, matrices, vectors)
    _gather(chain, frames, places, matrices, vectors, hessian, gradient)
    cost += _add_prior(evidence.prior, pose, hessian, gradient)
    if evidence.weight != 1.0:
        cost *= evidence.weight
        hessian *= evidence.weight
        gradient *= evidence.weight
    return cost + _add_anchor(anchor, pose, hessian, gradient)


@_jit
def _add_point(matrix: Array, vector: Array, arm: Array, information: Array, pull: Array) -> None:
    """A point at `arm` (3,) from the root with information (3, 3) and gradient (3,): S^T W S, S =
    [-[arm] I]."""
    x, y, z = arm[0], arm[1], arm[2]
    for j in range(3):
        a = -z * information[1, j] + y * information[2, j]
        b = z * information[0, j] - x * information[2, j]
        c = -y * information[0, j] + x * information[1, j]
        matrix[0, 3 + j] += a
        matrix[1, 3 + j] += b
        matrix[2, 3 + j] += c
        matrix[3 + j, 0] += a
        matrix[3 + j, 1] += b
        matrix[3 + j, 2] += c
        for i in range(3):
            matrix[3 + i, 3 + j] += information[i, j]
        # column j of [arm] W times [arm]^T
        if j == 0:
            a0, b0, c0 = a, b, c
        elif j == 1:
            a1, b1, c1 = a, b, c
        else:
            a2, b2, c2 = a, b, c
    matrix[0, 0] += -z * a1 + y * a2
    matrix[0, 1] += z * a0 - x * a2
    matrix[0, 2] += -y * a0 + x * a1
    matrix[1, 0] += -z * b1 + y * b2
    matrix[1, 1] += z * b0 - x * b2
    matrix[1, 2] += -y * b0 + x * b1
    matrix[2, 0] += -z * c1 + y * c2
    matrix[2, 1] += z * c0 - x * c2
    matrix[2, 2] += -y * c0 + x * c1
    vector[0] += -z * pull[1] + y * pull[2]
    vector[1] += z * pull[0] - x * pull[2]
    vector[2] += -y * pull[0] + x * pull[1]
    for i in range(3):
        vector[3 + i] += pull[i]


@_jit
def _site(frame: Array, place: Array, offset: Array, out: Array) -> None:
    for j in range(3):
        out[j] = place[j] + frame[j, 0] * offset[0] + frame[j, 1] * offset[1] + frame[j, 2] * offset[2]


@_jit
def _add_views(targets: ViewTargets, frames: Array, places: Array, matrices: Array, vectors: Array) -> float:
    cost = 0.0
    point, pull, information = np.empty(3), np.empty(3), np.empty((3, 3))
    across, down = np.empty(3), np.empty(3)
    for n in range(len(targets.segments)):
        weight = targets.weights[n]
        if weight <= 0.0:
            continue
        s, rotation, shift = targets.segments[n], targets.rotations[targets.cameras[n]], targets.translations
        _site(frames[s], places[s], targets.offsets[n], point)
        k = targets.cameras[n]
        depth = (
            rotation[2, 0] * point[0] + rotation[2, 1] * point[1] + rotation[2, 2] * point[2] + shift[k, 2]
        )
        if depth < NEAREST:
            continue
        u = (
            rotation[0, 0] * point[0] + rotation[0, 1] * point[1] + rotation[0, 2] * point[2] + shift[k, 0]
        ) / depth
        v = (
            rotation[1, 0] * point[0] + rotation[1, 1] * point[1] + rotation[1, 2] * point[2] + shift[k, 1]
        ) / depth
        ru, rv = u - targets.points[n, 0], v - targets.points[n, 1]
        error = weight * (ru * ru + rv * rv)
        if targets.scale > 0.0:
            cost += targets.scale * math.log(1.0 + error / targets.scale)
            weight /= 1.0 + error / targets.scale
        else:
            cost += error
        for j in range(3):
            across[j] = (rotation[0, j] - u * rotation[2, j]) / depth
            down[j] = (rotation[1, j] - v * rotation[2, j]) / depth
            point[j] -= places[0, j]
        for i in range(3):
            pull[i] = weight * (across[i] * ru + down[i] * rv)
            for j in range(3):
                information[i, j] = weight * (across[i] * across[j] + down[i] * down[j])
        _add_point(matrices[s], vectors[s], point, information, pull)
    return cost


@_jit
def _add_points(
    targets: PointTargets, frames: Array, places: Array, matrices: Array, vectors: Array
) -> float:
    cost = 0.0
    point, pull, information, error_of = np.empty(3), np.empty(3), np.empty((3, 3)), np.empty(3)
    for n in range(len(targets.segments)):
        s = targets.segments[n]
        _site(frames[s], places[s], targets.offsets[n], point)
        error = 0.0
        for j in range(3):
            error_of[j] = point[j] - targets.goals[n, j]
        for j in range(3):
            w = targets.information[n]
            pull[j] = w[j, 0] * error_of[0] + w[j, 1] * error_of[1] + w[j, 2] * error_of[2]
            error += pull[j] * error_of[j]
        kept = 1.0
        if targets.scale > 0.0:
            cost += targets.scale * math.log(1.0 + error / targets.scale)
            kept = 1.0 / (1.0 + error / targets.scale)
        else:
            cost += error
        for i in range(3):
            pull[i] *= kept
            point[i] -= places[0, i]
            for j in range(3):
                information[i, j] = kept * targets.information[n, i, j]
        _add_point(matrices[s], vectors[s], point, information, pull)
    return cost


@_jit
def _add_turns(targets: TurnTargets, frames: Array, matrices: Array, vectors: Array) -> float:
    """sin^2(a / 2) of the angle a: its gradient is that of k a^2 with k = sin(a) / (4 a)."""
    cost = 0.0
    apart, vector = np.empty((3, 3)), np.empty(3)
    for n in range(len(targets.segments)):
        s = targets.segments[n]
        for i in range(3):
            for j in range(3):
                apart[i, j] = (
                    frames[s, i, 0] * targets.goals[n, j, 0]
                    + frames[s, i, 1] * targets.goals[n, j, 1]
                    + frames[s, i, 2] * targets.goals[n, j, 2]
                )
        vector_of(apart, vector)
        angle = math.sqrt(vector[0] ** 2 + vector[1] ** 2 + vector[2] ** 2)
        half = math.sin(0.5 * angle)
        error = targets.weights[n] * half * half
        weight = targets.weights[n] * (0.25 if angle < 1e-4 else math.sin(angle) / (4.0 * angle))
        if targets.scale > 0.0:
            cost += targets.scale * math.log(1.0 + error / targets.scale)
            weight /= 1.0 + error / targets.scale
        else:
            cost += error
        for i in range(3):
            vectors[s, i] += weight * vector[i]
            matrices[s, i, i] += weight
    return cost


@_jit
def _add_floor(floor: Floor, places: Array, matrices: Array, vectors: Array) -> float:
    cost = 0.0
    arm, pull, information = np.empty(3), np.zeros(3), np.zeros((3, 3))
    for n in range(len(floor.segments)):
        s = floor.segments[n]
        below = floor.radius - places[s, 2]
        if below > 0.0 and floor.weight > 0.0:
            cost += floor.weight * below * below
            pull[2] = -floor.weight * below
            information[2, 2] = floor.weight
            for j in range(3):
                arm[j] = places[s, j] - places[0, j]
            _add_point(matrices[s], vectors[s], arm, information, pull)
    return cost


@_jit
def _gather(
    chain: Chain,
    frames: Array,
    places: Array,
    matrices: Array,
    vectors: Array,
    hessian: Array,
    gradient: Array,
) -> None:
    """From segments to degrees of freedom."""
    count = len(chain.parents)
    for s in range(count - 1, 0, -1):
        parent = chain.parents[s]
        for i in range(6):
            vectors[parent, i] += vectors[s, i]
            for j in range(6):
                matrices[parent, i, j] += matrices[s, i, j]
    axes = np.empty((count, 6, 3))
    for s in range(count):
        x, y, z = places[s, 0] - places[0, 0], places[s, 1] - places[0, 1], places[s, 2] - places[0, 2]
        for k in range(3):
            if s == 0:
                a, b, c = 1.0 * (k == 0), 1.0 * (k == 1), 1.0 * (k == 2)
            else:
                parent = chain.parents[s]
                a, b, c = frames[parent, 0, k], frames[parent, 1, k], frames[parent, 2, k]
            axes[s, 0, k], axes[s, 1, k], axes[s, 2, k] = a, b, c
            axes[s, 3, k], axes[s, 4, k], axes[s, 5, k] = y * c - z * b, z * a - x * c, x * b - y * a
    hessian[:] = 0.0
    force = np.empty((6, 3))
    for s in range(count):
        row = 3 + 3 * s
        for k in range(3):
            total = 0.0
            for j in range(6):
                total += axes[s, j, k] * vectors[s, j]
            gradient[row + k] = total
            for i in range(6):
                total = 0.0
                for j in range(6):
                    total += matrices[s, i, j] * axes[s, j, k]
                force[i, k] = total
        above = s
        while above >= 0:
            column = 3 + 3 * above
            for i in range(3):
                for k in range(3):
                    total = 0.0
                    for j in range(6):
                        total += axes[above, j, i] * force[j, k]
                    hessian[column + i, row + k] = total
                    hessian[row + k, column + i] = total
            above = chain.parents[above]
        for i in range(3):
            for k in range(3):
                hessian[i, row + k] = force[3 + i, k]
                hessian[row + k, i] = force[3 + i, k]
    for i in range(3):
        gradient[i] = vectors[0, 3 + i]
        for k in range(3):
            hessian[i, k] = matrices[0, 3 + i, 3 + k]


@_jit
def _add_prior(prior: PosePrior, pose: Pose, hessian: Array, gradient: Array) -> float:
    weigh = prior.projection_weight > 0.0 or prior.deviation_weight > 0.0
    if not weigh and prior.limit_weight <= 0.0:
        return 0.0
    n = len(prior.mean)
    count = n // 3
    vectors, pull, apart = np.empty(n), np.zeros(n), np.empty(n)
    slopes = np.empty((count, 3, 3))
    for s in range(count):
        vector_of(pose.turns[s + 1], vectors[3 * s : 3 * s + 3])
        inverse_left_jacobian(vectors[3 * s : 3 * s + 3], slopes[s])
    cost, first, second = 0.0, 0.0, 0.0
    if weigh:
        for i in range(n):
            apart[i] = vectors[i] - prior.mean[i]
        projected, deviated = prior.projection @ apart, prior.deviation @ apart
        far, odd = 0.0, 0.0
        for i in range(n):
            far += apart[i] * projected[i]
            odd += apart[i] * deviated[i]
        far *= prior.projection_weight
        odd *= prior.deviation_weight
        first, second = prior.projection_weight, prior.deviation_weight
        if prior.projection_scale > 0.0:
            cost += prior.projection_scale * math.log(1.0 + far / prior.projection_scale)
            first /= 1.0 + far / prior.projection_scale
        else:
            cost += far
        if prior.deviation_scale > 0.0:
            cost += prior.deviation_scale * math.log(1.0 + odd / prior.deviation_scale)
            second /= 1.0 + odd / prior.deviation_scale
        else:
            cost += odd
        for i in range(n):
            pull[i] = first * projected[i] + second * deviated[i]
    stiff = np.zeros(n)
    if prior.limit_weight > 0.0:
        for i in range(n):
            beyond = max(vectors[i] - prior.upper[i], 0.0) + min(vectors[i] - prior.lower[i], 0.0)
            if beyond != 0.0:
                cost += prior.limit_weight * beyond * beyond
                pull[i] += prior.limit_weight * beyond
                stiff[i] = prior.limit_weight
    block, half = np.empty((3, 3)), np.empty((3, 3))
    for a in range(count):
        for i in range(3):
            gradient[6 + 3 * a + i] += (
                slopes[a, 0, i] * pull[3 * a]
                + slopes[a, 1, i] * pull[3 * a + 1]
                + slopes[a, 2, i] * pull[3 * a + 2]
            )
        for b in range(a + 1):
            if not weigh and a != b:
                continue
            for i in range(3):
                for j in range(3):
                    block[i, j] = (
                        first * prior.projection[3 * a + i, 3 * b + j]
                        + second * prior.deviation[3 * a + i, 3 * b + j]
                    )
                if a == b:
                    block[i, i] += stiff[3 * a + i]
            multiply(block, slopes[b], half)
            for i in range(3):
                for j in range(3):
                    total = (
                        slopes[a, 0, i] * half[0, j]
                        + slopes[a, 1, i] * half[1, j]
                        + slopes[a, 2, i] * half[2, j]
                    )
                    hessian[6 + 3 * a + i, 6 + 3 * b + j] += total
                    if a != b:
                        hessian[6 + 3 * b + j, 6 + 3 * a + i] += total
    return cost


@_jit
def _add_anchor(anchor: Anchor, pose: Pose, hessian: Array, gradient: Array) -> float:
    if anchor.weight <= 0.0:
        return 0.0
    step = np.empty(len(gradient))
    step_between(Pose(anchor.root, anchor.turns), pose, step)
    pulled = anchor.information @ step
    cost = 0.0
    for i in range(len(step)):
        cost += step[i] * (pulled[i] + 2.0 * anchor.gradient[i])
        gradient[i] += anchor.weight * (pulled[i] + anchor.gradient[i])
    hessian += anchor.weight * anchor.information
    return anchor.weight * cost
