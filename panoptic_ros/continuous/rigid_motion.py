"""Curves of all joints of a person at once: the prior of joints that share the motion of a rigid part.

The prior of single joints is learnt again with the lengths. The lengths are conditions, not results of that
prior: else the prior of one motion would count once per joint of a rigid part. MacKay's rule then counts the
free share of the prior of each joint instead of its three coordinates.
"""

from __future__ import annotations

import numpy as np

from panoptic_ros.continuous.bones import (
    INTERVAL_S,
    SHORTEST,
    LearntLengths,
    block_inverses,
    length_weights,
    step_with_lengths,
)
from panoptic_ros.continuous.curves import CurveFit, all_third_differences, jerk_weights
from panoptic_ros.continuous.problem import STEP_S, CurveProblem, stiffness_sums, within_limits
from panoptic_ros.geometry.splines import DEGREE, SPAN, weights_at

Array = np.ndarray
# number of Gauss-Newton steps. Three cameras of 6.4 Hz need four or more, 8 of 12.5 Hz need two
LEAST_STEPS, MOST_STEPS = 2, 5
SETTLED = 0.2  # mean change of the logarithm of the stiffness up to which there is no further step
POSES = 9  # number of poses over which the free share of the motion of each joint is averaged
FREQUENCIES = 32  # number of frequencies up to half the rate of the knots over which it is averaged


def fit_with_lengths(problem: CurveProblem, fit: CurveFit, pairs: Array, learnt: LearntLengths) -> CurveFit:
    """Return the curves of a person whose joints keep the learnt lengths, with their covariances.

    Args:
        fit: curves fitted joint by joint, the start.
    """
    joints = len(fit.points)
    parts = rigid_parts(pairs, joints)
    # the density of the jerk is a mean over the part: a joint that is too stiff would stop all others
    marginal = 1.0 / (parts @ (1.0 / problem.stiffness))
    shares = free_shares(fit.points, pairs, learnt, marginal)
    stiffness = marginal * shares[:, None]
    weights = length_weights(problem, fit, pairs, learnt)
    blocks = np.empty((problem.grid.number, SPAN, 3 * joints, 3 * joints))
    for step in range(1, MOST_STEPS + 1):
        points = step_with_lengths(problem, fit.points, pairs, learnt, weights, stiffness, blocks)
        inverses = block_inverses(blocks)
        fit = fit._replace(points=points, inverses=inverses)
        problem.compare(fit)
        shares = free_shares(points, pairs, learnt, stiffness)
        differences, spreads = all_third_differences(points, inverses, problem.grid.step)
        sums = stiffness_sums(stiffness, differences, spreads, problem.inside, 3.0 * shares[:, None])
        before, stiffness = stiffness, within_limits((parts @ sums[0]) / (parts @ sums[1]))
        if step >= LEAST_STEPS and np.abs(np.log(stiffness / before)).mean() < SETTLED:
            break
    return fit


def rigid_parts(pairs: Array, joints: int) -> Array:
    """Return the weights (J, J) with which joints share a prior: equal within a rigid part, rows sum to 1.

    Two joints of a pair belong to a part if a third joint has pairs with both. A joint of bones alone has
    its own prior.
    """
    paired = np.zeros((joints, joints))
    paired[pairs[:, 0], pairs[:, 1]] = paired[pairs[:, 1], pairs[:, 0]] = 1.0
    weights = paired * (paired @ paired > 0.0) + np.eye(joints)
    parts: Array = weights / weights.sum(axis=1, keepdims=True)
    return parts


def free_shares(points: Array, pairs: Array, learnt: LearntLengths, stiffness: Array) -> Array:
    """Return the share (J,) of the prior of each joint that the lengths leave free.

    It is the trace of the prior's covariance given the lengths, in units of the covariance without them. The
    curves are taken as stationary, so each frequency is a small system of all joints.

    Args:
        points: (J, K, 3) m, control points.
        stiffness: (J, K - ORDER) 1/m^2.
    """
    joints, count, _ = points.shape
    used = learnt.weights > 0.0
    first, second = pairs[used].T
    ratios = length_ratios()
    total = np.zeros(joints)
    for k in np.linspace(0, count - DEGREE, POSES).round().astype(np.int64):
        gaps = points[first, k + DEGREE // 2] - points[second, k + DEGREE // 2]
        gaps *= (np.sqrt(learnt.weights[used]) / np.maximum(np.linalg.norm(gaps, axis=1), SHORTEST))[:, None]
        rows = np.zeros((len(gaps), joints, 3))
        rows[np.arange(len(gaps)), first], rows[np.arange(len(gaps)), second] = gaps, -gaps
        rows /= np.sqrt(stiffness[:, min(k, stiffness.shape[1] - 1)])[:, None]
        _, values, axes = np.linalg.svd(rows.reshape(len(gaps), 3 * joints), full_matrices=False)
        leverages = 1.0 - (1.0 / (1.0 + values[:, None] ** 2 * ratios)).mean(axis=1)
        total += (leverages @ axes**2).reshape(joints, 3).mean(axis=1)
    shares: Array = 1.0 - total / POSES
    return shares


def length_ratios() -> Array:
    """Return the squared responses (FREQUENCIES,) of a curve over those of its third differences.

    The former are sums over the measurements of a length between two knots.
    """
    turns = np.exp(1j * np.pi * (np.arange(FREQUENCIES) + 0.5) / FREQUENCIES)
    basis = np.empty(DEGREE + 1)
    squares = np.zeros(FREQUENCIES)
    for place in np.arange(0.0, 1.0, INTERVAL_S / STEP_S):
        weights_at(place, 2 * DEGREE, basis)
        squares += np.abs(np.polyval(basis, turns)) ** 2
    ratios: Array = squares / np.abs(np.polyval(jerk_weights(STEP_S), turns)) ** 2
    return ratios
