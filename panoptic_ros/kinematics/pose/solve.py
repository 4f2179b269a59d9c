"""Levenberg-Marquardt optimisation of one pose. A warm start needs two or three iterations."""

from __future__ import annotations

import math

import numpy as np

from panoptic_ros.geometry.chain import Pose, step_pose
from panoptic_ros.geometry.segment_chain import Chain
from panoptic_ros.kernels import njit
from panoptic_ros.kinematics.pose.normal_equations import assemble
from panoptic_ros.kinematics.pose.targets import Anchor, PoseEvidence

Array = np.ndarray
FIRST_DAMPING, LEAST_DAMPING, MOST_DAMPING = 1e-4, 1e-7, 1e6
# First damping, after a failed iteration, where the pose has an anchor. An anchor is far stiffer along some
# directions than along others. Damping in proportion to its diagonal would block directions along which the
# evidence moves the pose. The cost of the anchor also says nothing about the gain in the evidence.
ANCHORED_DAMPING = 1e-8
LEAST_STEP = 1e-4  # m or rad: with an anchor, iterate again while an element of the increment is larger
RIDGE = 1e-9  # added to the diagonal, so that unobserved degrees of freedom do not move
LEAST_GAIN = 1e-4  # minimum relative decrease of the cost for another iteration

_jit = njit(cache=True, error_model="numpy", nogil=True)


@njit(cache=True, error_model="numpy", nogil=True, fastmath={"reassoc", "contract"})
def factorise(matrix: Array, damping: float, factor: Array) -> bool:
    """Compute the Cholesky factor (N, N) of a damped matrix into `factor`.

    Args:
        damping: Fraction of each diagonal element that is added to it.

    Returns:
        False if the damped matrix is not positive definite.
    """
    for i in range(len(matrix)):
        for j in range(i + 1):
            total = matrix[i, j]
            if i == j:
                total += damping * (total + 1e-6) + RIDGE
            for k in range(j):
                total -= factor[i, k] * factor[j, k]
            if i > j:
                factor[i, j] = total / factor[j, j]
            elif total > 0.0:
                factor[i, i] = math.sqrt(total)
            else:
                return False
    return True


@_jit
def _solve_factorised(factor: Array, gradient: Array, step: Array) -> None:
    """Solve factor factor^T step = -gradient for `step` (N,), which is the output."""
    n = len(gradient)
    for i in range(n):
        total = -gradient[i]
        for k in range(i):
            total -= factor[i, k] * step[k]
        step[i] = total / factor[i, i]
    for i in range(n - 1, -1, -1):
        step[i] /= factor[i, i]
        for k in range(i):
            step[k] -= factor[i, k] * step[i]


@_jit
def solve_pose(
    chain: Chain, pose: Pose, evidence: PoseEvidence, anchor: Anchor, iterations: int, hessian: Array
) -> tuple[float, int]:
    """Change `pose` to minimise its cost: evidence and anchor.

    Args:
        iterations: Maximum number of iterations.
        hessian: (D, D) output, half of the second derivatives at the last linearisation.

    Returns:
        The final cost and the number of iterations.
    """
    size = 3 + 3 * len(chain.parents)
    gradient, step, factor = np.empty(size), np.empty(size), np.empty((size, size))
    other_hessian, other_gradient = np.empty((size, size)), np.empty(size)
    other = Pose(pose.root.copy(), pose.turns.copy())
    anchored = anchor.weight > 0.0
    least, first = (0.0, ANCHORED_DAMPING) if anchored else (LEAST_DAMPING, FIRST_DAMPING)
    damping = 0.0 if anchored else FIRST_DAMPING
    cost = assemble(chain, pose, evidence, anchor, hessian, gradient)
    done = 0
    while done < iterations:
        done += 1
        better = False
        if factorise(hessian, damping, factor):
            _solve_factorised(factor, gradient, step)
            step_pose(pose, step, other)
            reached = assemble(chain, other, evidence, anchor, other_hessian, other_gradient)
            better = reached <= cost
        if better:
            gain = cost - reached
            pose.root[:] = other.root
            pose.turns[:] = other.turns
            hessian[:] = other_hessian
            gradient[:] = other_gradient
            cost = reached
            damping = max(0.3 * damping, least)
            if anchored:
                if np.abs(step).max() < LEAST_STEP:
                    break
            elif gain < LEAST_GAIN * abs(cost) + 1e-12:
                break
        else:
            damping = max(10.0 * damping, first)
            if damping > MOST_DAMPING:
                break
    return cost, done
