"""Terms of a pose as a whole: what poses look like, and the pose that is expected; each returns its cost."""

from __future__ import annotations

import math

import numpy as np

from panoptic_ros.geometry.chain import Pose, multiply, step_between
from panoptic_ros.geometry.rotations import inverse_left_jacobian, vector_of
from panoptic_ros.kernels import njit
from panoptic_ros.kinematics.pose.targets import Anchor, Hinges, PosePrior

Array = np.ndarray

_jit = njit(cache=True, error_model="numpy", nogil=True)


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
