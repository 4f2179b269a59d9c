"""What the window puts together of large matrices, each in one pass over them.

Of symmetric matrices rows are read where columns are meant, as they lie one after the other in memory.

What lies between three instants is given as normal equations of one pose that stand for all three. Slopes
hardly change from an instant to the next, so those of one pose serve for all. A second difference x0 - 2
x1 + x2 of what has slopes J then has the matrix c_a c_b J^T W J between the steps a and b, with c = (1,
-2, 1), and a first difference the same with c = (-1, 1): one sum over the segments serves for all blocks.
Where the later step of time is r times the one before, c = (r, -1 - r, 1).
"""

from __future__ import annotations

import math

import numpy as np

from panoptic_ros.geometry.chain import Pose, place_segments, step_between
from panoptic_ros.geometry.rotations import vector_of
from panoptic_ros.geometry.segment_chain import Chain
from panoptic_ros.kernels import njit
from panoptic_ros.kinematics.pose.segment_sums import add_point, gather, place_site
from panoptic_ros.kinematics.pose.targets import Accelerations, Between, Standing, Turning

Array = np.ndarray

_jit = njit(cache=True, error_model="numpy", nogil=True)

ENOUGH = 3  # sites, whose mean acceleration tells that of the body
RIDGE = 1e-6


@_jit
def add_second_differences(
    chain: Chain,
    poses: tuple[Pose, Pose, Pose],
    given: Accelerations,
    times: tuple[float, float],
    matrix: Array,
    vector: Array,
) -> None:
    """Accelerations of sites, into (D, D) and (D,).

    Args:
        times: ratio of the later step of time to the one before, and the period, s, whose square is by how
            much an acceleration bends the way between three poses.

    The slopes are those of the middle pose. With slopes of their own, which differ a little and are divided
    by the period squared, the three poses would seem to know the orientation itself, and what is linearised
    at one pose and kept while the pose moves on would bend the body out of shape.

    The last pose is where a constant velocity brings it, so all sites of a body that stops or starts are off
    alike. That is no outlier: the loss is of how far a site is off from all of them, if they are enough.
    """
    count, size = len(chain.parents), len(vector)
    ratio, period = times
    frames, places = np.empty((3, count, 3, 3)), np.empty((3, count, 3))
    for k in range(3):
        place_segments(chain, poses[k], frames[k], places[k])
    number = len(given.segments)
    sites, errors, common = np.empty((3, 3)), np.empty((number, 3)), np.zeros(3)
    alike = given.relative or number >= ENOUGH
    for n in range(number):
        s = given.segments[n]
        for k in range(3):
            place_site(frames[k, s], places[k, s], given.offsets[n], sites[k])
        for j in range(3):
            bend = (ratio * sites[0, j] - (1.0 + ratio) * sites[1, j] + sites[2, j]) / period**2
            errors[n, j] = bend - given.values[n, j]
            common[j] += errors[n, j] / number
    matrices, vectors = np.zeros((count, 6, 6)), np.zeros((count, 6))
    arm, pull, information = np.empty(3), np.empty(3), np.zeros((3, 3))
    for n in range(number):
        s = given.segments[n]
        weight = given.weights[n]
        if given.scale > 0.0:
            error = 0.0
            for j in range(3):
                error += (errors[n, j] - common[j] * alike) ** 2
            weight /= 1.0 + weight * error / given.scale
        place_site(frames[1, s], places[1, s], given.offsets[n], arm)
        for j in range(3):
            arm[j] -= places[1, 0, j]
            pull[j] = weight * errors[n, j] / period**2
            information[j, j] = weight / period**4
        add_point(matrices[s], vectors[s], arm, information, pull)
    found, slope = np.empty((size, size)), np.empty(size)
    gather(chain, frames[1], places[1], matrices, vectors, found, slope)
    if given.relative:
        # a part that all sites share is free: it moves the root alone, and is eliminated
        total = found[0, 0]
        for i in range(size - 1, -1, -1):
            for k in range(3):
                slope[i] -= found[i, k] * slope[k] / total
            for j in range(i, -1, -1):
                for k in range(3):
                    found[i, j] -= found[i, k] * found[j, k] / total
                found[j, i] = found[i, j]
    matrix += found
    vector += slope


@_jit
def first_differences(
    chain: Chain, begin: Pose, end: Pose, turning: Turning, standing: Standing, matrix: Array, vector: Array
) -> None:
    """Turns of segments and sites that stand, into (D, D) and (D,), with the slopes of the earlier pose."""
    count = len(chain.parents)
    frames, places = np.empty((count, 3, 3)), np.empty((count, 3))
    later, there = np.empty((count, 3, 3)), np.empty((count, 3))
    place_segments(chain, begin, frames, places)
    place_segments(chain, end, later, there)
    matrices, vectors = np.zeros((count, 6, 6)), np.zeros((count, 6))
    apart, error = np.empty((3, 3)), np.empty(3)
    for n in range(len(turning.segments)):
        s, weight = turning.segments[n], turning.weights[n]
        goal = turning.changes[n] @ frames[s]
        for i in range(3):
            for j in range(3):
                apart[i, j] = (
                    later[s, i, 0] * goal[j, 0] + later[s, i, 1] * goal[j, 1] + later[s, i, 2] * goal[j, 2]
                )
        vector_of(apart, error)
        for i in range(3):
            vectors[s, i] += weight * error[i]
            matrices[s, i, i] += weight
    arm, moved, information = np.empty(3), np.empty(3), np.zeros((3, 3))
    for n in range(len(standing.segments)):
        s, weight = standing.segments[n], standing.weights[n]
        place_site(frames[s], places[s], standing.offsets[n], arm)
        place_site(later[s], there[s], standing.offsets[n], moved)
        for j in range(3):
            moved[j] = weight * (moved[j] - arm[j] - standing.moves[n, j])
            arm[j] -= places[0, j]
            information[j, j] = weight
        add_point(matrices[s], vectors[s], arm, information, moved)
    gather(chain, frames, places, matrices, vectors, matrix, vector)


@_jit
def add_motion(
    information: Array, second: tuple[Array, Array, float], first: tuple[Array, Array], rest: Array
) -> None:
    """What the last pose, the new one and 1 have with one another when the pose before is eliminated.

    Args:
        information: (2 D, 2 D) of the pose before and the last one.
        second, first: matrix (D, D) and vector (D,) of second and first differences; of the second ones
            also the ratio of the later step of time to the one before.
        rest: (2 D + 1, 2 D + 1), what is eliminated; the result, but for the block below the diagonal.
    """
    bend, slope, ratio = second
    turn, pull = first
    n, middle = len(slope), 1.0 + ratio
    for i in range(n):
        for j in range(n):
            k, t = bend[i, j], turn[i, j]
            rest[i, j] = information[n + i, n + j] + middle * middle * k + t - rest[i, j]
            rest[i, n + j] = -middle * k - t - rest[i, n + j]
            rest[n + i, n + j] = k + t - rest[n + i, n + j]
        rest[i, 2 * n] = -middle * slope[i] - pull[i] - rest[i, 2 * n]
        rest[n + i, 2 * n] = slope[i] + pull[i] - rest[n + i, 2 * n]


@_jit
def motion_between(
    chain: Chain,
    poses: tuple[Pose, Pose, Pose],
    between: Between,
    weights: Array,
    times: tuple[float, float, float],
    second: tuple[Array, Array],
    first: tuple[Array, Array],
) -> None:
    """Matrix (D, D) and vector (D,) of second differences of three poses, and of first differences of the
    later two.

    Args:
        weights: (D,) of second differences where steps of time are of one period.
        times: ratio of the later step of time to the one before; half of the product of the later one and
            both, periods^2, which is 1 where all are of one; period, s.
    """
    bend, slope = second
    turn, pull = first
    ratio, steps, period = times
    before = np.empty(len(slope))
    step_between(poses[0], poses[1], before)
    step_between(poses[1], poses[2], slope)
    bend[:] = 0.0
    for i in range(len(slope)):
        weight = weights[i] / steps**2
        bend[i, i] = weight
        slope[i] = weight * (slope[i] - ratio * before[i])
    given = between.accelerations
    if len(given.segments):
        add_second_differences(chain, poses, given, (ratio, math.sqrt(steps) * period), bend, slope)
    first_differences(chain, poses[1], poses[2], between.turning, between.standing, turn, pull)
    for i in range(len(pull)):
        turn[i, i] += RIDGE


@_jit
def begin_elimination(
    information: Array, pulled: Array, second: tuple[Array, Array], ratio: float, corner: Array, rows: Array
) -> None:
    """The pose before the last, with itself (D, D), and against the last, the new one, 1, and errors that
    last, (D, 3 D + 1) by columns.

    Args:
        information, pulled: (2 D, 2 D) and (2 D, D) of the pose before the last and the last one.
        second: matrix and vector of second differences.
    """
    bend, slope = second
    n, middle = len(slope), ratio * (1.0 + ratio)
    for j in range(n):
        for i in range(n):
            k = bend[j, i]
            corner[j, i] = information[j, i] + ratio**2 * k
            rows[i, j] = information[n + j, i] - middle * k
            rows[i, n + j] = ratio * k
        for i in range(n):
            rows[i, 2 * n + 1 + j] = pulled[i, j]
        rows[j, 2 * n] = ratio * slope[j]


@_jit
def left_over(rest: Array, product: Array, information: Array, gradient: Array) -> None:
    """What is known of the new pose (D, D) and (D,), once the last one is eliminated too.

    Args:
        rest: (2 D + 1, 2 D + 1) of both and 1. product: (D, D + 1), what the last one takes away.
    """
    n = len(gradient)
    for i in range(n):
        for j in range(n):
            information[i, j] = rest[n + i, n + j] - product[i, j]
        gradient[i] = rest[n + i, 2 * n] - product[i, n]


@_jit
def told_by(hessian: Array, anchor: Array, free: Array, own: Array, opened: Array) -> None:
    """What the evidence of an instant says (D, D), and the same with what it leaves open."""
    for i in range(len(own)):
        for j in range(len(own)):
            own[i, j] = hessian[i, j] - anchor[i, j]
            opened[i, j] = own[i, j] + free[i, j]


@_jit
def join(
    rest: Array, told: tuple[Array, Array], pulls: tuple[Array, Array, Array], joint: Array, pulled: Array
) -> None:
    """What is known of the last pose and the new one (2 D, 2 D), and by how much errors that last pull them.

    Args:
        rest: before the evidence. told: half of the second derivatives with the anchor, and of the anchor.
        pulls: what elimination takes away (2 D, D), before it (2 D, D), and of the new pose (D, D).
    """
    hessian, anchor = told
    product, before, root = pulls
    n = len(hessian)
    for i in range(n):
        for j in range(n):
            joint[i, j] = rest[i, j]
            joint[i, n + j] = rest[i, n + j]
            joint[n + j, i] = rest[i, n + j]
            joint[n + i, n + j] = rest[n + i, n + j] + hessian[i, j] - anchor[i, j]
            pulled[i, j] = before[n + i, j] - product[i, j]
            pulled[n + i, j] = root[i, j] - product[n + i, j]


@_jit
def meet(
    here: tuple[Array, Array],
    later: tuple[Array, Array],
    corner: Array,
    rows: Array,
    own: Array,
    pulled: Array,
) -> None:
    """What came up to an instant and what came after it, (2 D, 2 D) and (2 D, D) each, added up: of the pose
    before with itself (D, D), against the one at it and errors that last (D, 2 D) by columns, and of the one
    at it (D, D) and (D, D)."""
    n = len(own)
    for j in range(n):
        for i in range(n):
            corner[j, i] = here[0][j, i] + later[0][i, j]
            rows[i, j] = here[0][n + j, i] + later[0][i, n + j]
            own[j, i] = here[0][n + j, n + i] + later[0][n + i, n + j]
        for i in range(n):
            rows[i, n + j] = here[1][i, j] + later[1][i, j]
            pulled[i, j] = here[1][n + i, j] + later[1][n + i, j]


@_jit
def steps_between(begin: tuple[Pose, Pose], end: tuple[Pose, Pose], steps: Array) -> None:
    """The steps (2 D,) that lead from each of two poses to another."""
    size = len(steps) // 2
    for k in range(2):
        step_between(begin[k], end[k], steps[k * size : (k + 1) * size])
