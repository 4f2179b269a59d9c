"""What the window puts together of large matrices, each in one pass over them.

Of symmetric matrices rows are read where columns are meant, as they lie one after the other in memory.
"""

from __future__ import annotations

import math

import numpy as np

from panoptic_ros.geometry.chain import Pose, step_between
from panoptic_ros.geometry.segment_chain import Chain
from panoptic_ros.kernels import njit
from panoptic_ros.kinematics.pose.motion_sums import add_second_differences, first_differences
from panoptic_ros.kinematics.pose.targets import Between

Array = np.ndarray
RIDGE = 1e-6

_jit = njit(cache=True, error_model="numpy", nogil=True)


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
