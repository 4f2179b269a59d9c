"""What lies between three instants, as normal equations of one pose that stand for all three.

Slopes hardly change from an instant to the next, so those of one pose serve for all. A second difference
x0 - 2 x1 + x2 of what has slopes J then has the matrix c_a c_b J^T W J between the steps a and b, with
c = (1, -2, 1), and a first difference the same with c = (-1, 1): one sum over the segments serves for all
blocks. Where the later step of time is r times the one before, c = (r, -1 - r, 1).
"""

from __future__ import annotations

import numpy as np

from panoptic_ros.geometry.chain import Pose, place_segments
from panoptic_ros.geometry.rotations import vector_of
from panoptic_ros.geometry.segment_chain import Chain
from panoptic_ros.kernels import njit
from panoptic_ros.kinematics.pose.segment_sums import add_point, gather, place_site
from panoptic_ros.kinematics.pose.targets import Accelerations, Standing, Turning

Array = np.ndarray
ENOUGH = 3  # sites, whose mean acceleration tells that of the body

_jit = njit(cache=True, error_model="numpy", nogil=True)


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
