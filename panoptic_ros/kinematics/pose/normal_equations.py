"""Cost of a pose and its normal equations, without the Jacobian: see `segment_sums`.

Targets of single segments are added to the sums of these segments. The prior and the anchor act on the pose
as a whole. Each `add_` function returns its cost.
"""

from __future__ import annotations

import math

import numpy as np

from panoptic_ros.geometry.chain import Pose, multiply, place_segments, step_between
from panoptic_ros.geometry.rotations import inverse_left_jacobian, vector_of
from panoptic_ros.geometry.segment_chain import Chain
from panoptic_ros.kernels import njit
from panoptic_ros.kinematics.pose.segment_sums import add_point, gather, place_site
from panoptic_ros.kinematics.pose.targets import (
    Anchor,
    FloorPoints,
    Hinges,
    OrientationTargets,
    PointTargets,
    PoseEvidence,
    PosePrior,
    ViewTargets,
)

Array = np.ndarray

_jit = njit(cache=True, error_model="numpy", nogil=True)

NEAREST = 0.1  # m, minimum depth in front of a camera


@_jit
def add_views(targets: ViewTargets, frames: Array, places: Array, matrices: Array, vectors: Array) -> float:
    cost = 0.0
    point, pull, information = np.empty(3), np.empty(3), np.empty((3, 3))
    across, down = np.empty(3), np.empty(3)
    for n in range(len(targets.segments)):
        weight = targets.weights[n]
        if weight <= 0.0:
            continue
        s, rotation, shift = targets.segments[n], targets.rotations[targets.cameras[n]], targets.translations
        place_site(frames[s], places[s], targets.offsets[n], point)
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
        add_point(matrices[s], vectors[s], point, information, pull)
    return cost


@_jit
def add_points(targets: PointTargets, frames: Array, places: Array, matrices: Array, vectors: Array) -> float:
    cost = 0.0
    point, pull, information, error_of = np.empty(3), np.empty(3), np.empty((3, 3)), np.empty(3)
    for n in range(len(targets.segments)):
        s = targets.segments[n]
        place_site(frames[s], places[s], targets.offsets[n], point)
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
        add_point(matrices[s], vectors[s], point, information, pull)
    return cost


@_jit
def add_turns(targets: OrientationTargets, frames: Array, matrices: Array, vectors: Array) -> float:
    """Add orientation targets and return their cost, sin^2(a / 2) for an angle a.

    The gradient is that of k a^2 with k = sin(a) / (4 a).
    """
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
def add_floor(floor: FloorPoints, places: Array, matrices: Array, vectors: Array) -> float:
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
            add_point(matrices[s], vectors[s], arm, information, pull)
    return cost


@_jit
def add_prior(prior: PosePrior, pose: Pose, hessian: Array, gradient: Array) -> float:
    weigh = prior.projection_weight > 0.0 or prior.deviation_weight > 0.0
    hinged = prior.hinges.weight > 0.0
    if not weigh and prior.limit_weight <= 0.0 and not hinged:
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
    if hinged:
        cost += _add_hinges(prior.hinges, pose, hessian, gradient)
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
def _add_hinges(hinges: Hinges, pose: Pose, hessian: Array, gradient: Array) -> float:
    cost = 0.0
    slope = np.empty(3)
    for n in range(len(hinges.segments)):
        s, axis = hinges.segments[n], hinges.axes[n]
        bone = pose.turns[s] @ hinges.bones[n]
        off = axis[0] * bone[0] + axis[1] * bone[1] + axis[2] * bone[2]
        slope[0] = bone[1] * axis[2] - bone[2] * axis[1]
        slope[1] = bone[2] * axis[0] - bone[0] * axis[2]
        slope[2] = bone[0] * axis[1] - bone[1] * axis[0]
        cost += hinges.weight * off * off
        row = 3 + 3 * s
        for i in range(3):
            gradient[row + i] += hinges.weight * off * slope[i]
            for j in range(3):
                hessian[row + i, row + j] += hinges.weight * slope[i] * slope[j]
    return cost


@_jit
def add_anchor(anchor: Anchor, pose: Pose, hessian: Array, gradient: Array) -> float:
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


@_jit
def assemble(
    chain: Chain, pose: Pose, evidence: PoseEvidence, anchor: Anchor, hessian: Array, gradient: Array
) -> float:
    """Return the cost of a pose, and compute its derivatives.

    The weights of robust targets are reduced by their residuals (Gauss-Newton on the reweighted cost).

    Args:
        hessian, gradient: (D, D) and (D,) outputs, half of the second and of the first derivatives.
    """
    count = len(chain.parents)
    frames, places = np.empty((count, 3, 3)), np.empty((count, 3))
    place_segments(chain, pose, frames, places)
    matrices, vectors = np.zeros((count, 6, 6)), np.zeros((count, 6))
    cost = add_views(evidence.views, frames, places, matrices, vectors)
    cost += add_points(evidence.points, frames, places, matrices, vectors)
    cost += add_turns(evidence.turns, frames, matrices, vectors)
    cost += add_floor(evidence.floor, places, matrices, vectors)
    gather(chain, frames, places, matrices, vectors, hessian, gradient)
    cost += add_prior(evidence.prior, pose, hessian, gradient)
    if evidence.weight != 1.0:
        cost *= evidence.weight
        hessian *= evidence.weight
        gradient *= evidence.weight
    return cost + add_anchor(anchor, pose, hessian, gradient)
