"""Assembly of the matrices of `window`, each in one pass over memory.

Symmetric matrices are read along rows instead of columns, because rows are contiguous in memory.

Measurements that relate three instants become the normal equations of one pose. The Jacobian hardly changes
between instants, so the Jacobian J of one pose is used for all three. For a second difference x0 - 2 x1 + x2,
instants a and b share the matrix c_a c_b J^T W J, with c = (1, -2, 1). A first difference has the same form,
with c = (-1, 1). One sum over the segments therefore gives all blocks. Where the later time step is r times
the earlier one, c = (r, -1 - r, 1).
"""

from __future__ import annotations

import math

import numpy as np

from panoptic_ros.geometry.chain import Pose, place_segments, step_between
from panoptic_ros.geometry.rotations import vector_of
from panoptic_ros.geometry.segment_chain import Chain
from panoptic_ros.kernels import njit
from panoptic_ros.kinematics.pose.segment_sums import add_point, gather, place_site
from panoptic_ros.kinematics.pose.targets import (
    Accelerations,
    IncrementEvidence,
    RotationIncrements,
    SiteDisplacements,
)

Array = np.ndarray

_jit = njit(cache=True, error_model="numpy", nogil=True)

ENOUGH = 3  # least number of sites whose mean acceleration represents that of the body
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
    """Add measured accelerations of sites to the matrix (D, D) and vector (D,) of second differences.

    The Jacobian is that of the middle pose. Jacobians of the three poses differ a little, and the differences
    would be divided by the squared period. The poses would then seem to determine the absolute orientation,
    and a linearisation that is kept while the pose moves would distort the body.

    The newest pose is a prediction at constant velocity. When a body stops or starts, the residuals of all
    sites share the error of that prediction, and this is not an outlier. With enough sites, the robust loss
    therefore acts on the difference of each residual from their mean.

    Args:
        poses: Poses of the last two instants and the new one, in order of time.
        times: Ratio of the later time step to the earlier one, and the period, s. The second difference
            divided by the squared period is an acceleration.
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
        # the common part of all accelerations is free: it moves the root alone, and is eliminated
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
    chain: Chain,
    begin: Pose,
    end: Pose,
    turning: RotationIncrements,
    standing: SiteDisplacements,
    matrix: Array,
    vector: Array,
) -> None:
    """Compute the matrix (D, D) and vector (D,) of first differences between two poses.

    They hold measured rotations of segments and displacements of standing sites. The Jacobian is that of the
    earlier pose.
    """
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
    """Compute the information about the last and the new pose, after elimination of the pose before them.

    Its last row and column are the linear term.

    Args:
        information: (2 D, 2 D), of the pose before the last and the last pose.
        second: Matrix (D, D) and vector (D,) of second differences, and the ratio of the later time step to
            the earlier one.
        first: Matrix (D, D) and vector (D,) of first differences.
        rest: (2 D + 1, 2 D + 1). On entry, the part that elimination subtracts. On return, the result,
            without the block below the diagonal.
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
    between: IncrementEvidence,
    weights: Array,
    times: tuple[float, float, float],
    second: tuple[Array, Array],
    first: tuple[Array, Array],
) -> None:
    """Compute the matrices (D, D) and vectors (D,) of second and first differences.

    Second differences relate all three poses, first differences the later two.

    Args:
        weights: (D,) of second differences whose time steps are one period long.
        times: Three values. The ratio of the later time step to the earlier one. Half of the product of the
            later step and the sum of both, periods^2, which is 1 where both are one period. The period, s.
        second, first: Outputs, matrix and vector each.
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
    """Assemble the blocks for the elimination of the pose before the last.

    Args:
        information, pulled: (2 D, 2 D) and (2 D, D) of the pose before the last and the last pose, see
            `window.WindowEntry`.
        second: Matrix and vector of second differences.
        ratio: Ratio of the later time step to the earlier one.
        corner: (D, D) output, the block of the pose with itself.
        rows: (D, 3 D + 1) output in column order, its blocks with the last pose, the new pose, the constant 1
            and persistent errors.
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
    """Compute the information (D, D) and gradient (D,) of the new pose once the last pose is eliminated too.

    Args:
        rest: (2 D + 1, 2 D + 1) of the last pose, the new pose and the constant 1.
        product: (D, D + 1), the part that the elimination of the last pose subtracts.
    """
    n = len(gradient)
    for i in range(n):
        for j in range(n):
            information[i, j] = rest[n + i, n + j] - product[i, j]
        gradient[i] = rest[n + i, 2 * n] - product[i, n]


@_jit
def told_by(hessian: Array, anchor: Array, free: Array, own: Array, opened: Array) -> None:
    """Compute the information of an instant's evidence.

    Args:
        hessian, anchor: (D, D), half of the second derivatives of the whole cost and of the anchor.
        free: (D, D), assumed information about unobserved degrees of freedom.
        own, opened: (D, D) outputs, the information without and with `free`.
    """
    for i in range(len(own)):
        for j in range(len(own)):
            own[i, j] = hessian[i, j] - anchor[i, j]
            opened[i, j] = own[i, j] + free[i, j]


@_jit
def join(
    rest: Array, told: tuple[Array, Array], pulls: tuple[Array, Array, Array], joint: Array, pulled: Array
) -> None:
    """Compute the joint information of the last two poses, and their sensitivity to persistent errors.

    Args:
        rest: (2 D + 1, 2 D + 1), information before the evidence of the new instant.
        told: Half of the second derivatives (D, D) of the cost with its anchor, and of the anchor alone.
        pulls: Sensitivities to persistent errors: the part that elimination subtracts (2 D, D), the value
            before elimination (2 D, D), and the value of the new pose (D, D).
        joint, pulled: (2 D, 2 D) and (2 D, D) outputs.
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
    """Add the information from before and after an instant.

    It is about the pose at the instant and the pose before that.

    Args:
        here, later: Information (2 D, 2 D) and sensitivity to persistent errors (2 D, D), up to the instant
            and after it.
        corner: (D, D) output, the block of the pose before with itself.
        rows: (D, 2 D) output in column order, the blocks of the pose before with the pose at the instant and
            with persistent errors.
        own, pulled: (D, D) outputs, information and sensitivity of the pose at the instant.
    """
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
    """Compute the increments (2 D,) that lead from each of two poses to another pose."""
    size = len(steps) // 2
    for k in range(2):
        step_between(begin[k], end[k], steps[k * size : (k + 1) * size])
