"""Filter of a person's joints that takes one view at a time, at the view's own timestamp (kernels).

The state of a joint is position, velocity and acceleration; its jerk is white noise. The density of the jerk
adapts to the innovations of the joint. The filter serves association and the newest instants; curves
(`continuous.curves`) give the motion of a recording.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.geometry.robust import noise_growth
from panoptic_ros.kernels import njit

Array = np.ndarray

SIZE = 9  # position, velocity and acceleration
# m/s^2.5, square root of the spectral density of the jerk: of a new joint, least and greatest
START_JERK, LEAST_JERK, MOST_JERK = 300.0, 20.0, 4000.0
ADAPTATION = 0.05  # change of the logarithm of the density per view and unit of excess of the innovation
MOST_EXCESS = 4.0  # greatest squared innovation, in units of its variance, that adapts the density
CAUCHY = 3.0  # scale of the robust weights, in standard deviations of the innovation
# standard deviations of a new joint: m along a ray of unknown depth, m/s, m/s^2
START_DEPTH, START_SPEED, START_ACCELERATION = 0.25, 2.0, 20.0


class JointFilters(NamedTuple):
    """Filters of J joints of one person.

    Args:
        states: (J, 3, 3) position m, velocity m/s and acceleration m/s^2, NaN = unknown joint.
        covariances: (J, SIZE, SIZE) in the order of a flattened state.
        jerks: (J,) m/s^2.5, square roots of the spectral densities of the jerk.
    """

    states: Array
    covariances: Array
    jerks: Array

    @classmethod
    def unknown(cls, joints: int) -> JointFilters:
        """Return filters of joints that were never measured."""
        return cls(
            np.full((joints, 3, 3), np.nan), np.zeros((joints, SIZE, SIZE)), np.full(joints, START_JERK)
        )

    def copy(self) -> JointFilters:
        """Return an independent copy."""
        return JointFilters(self.states.copy(), self.covariances.copy(), self.jerks.copy())


class ViewRays(NamedTuple):
    """Camera of a view, for the distances of joints from rays.

    Args:
        rotation: (3, 3) of cam_from_world.
        translation: (3,) m of cam_from_world.
    """

    rotation: Array
    translation: Array


@njit(cache=True, error_model="numpy", nogil=True)
def predict(filters, dt):
    """Predict all joints by dt (s), in place; dt may be negative."""
    states, covariances, jerks = filters
    half, gap = 0.5 * dt * dt, abs(dt)
    sign = 1.0 if dt >= 0.0 else -1.0
    noise = np.empty((3, 3))
    noise[0, 0], noise[0, 1], noise[0, 2] = gap**5 / 20.0, sign * gap**4 / 8.0, gap**3 / 6.0
    noise[1, 1], noise[1, 2], noise[2, 2] = gap**3 / 3.0, sign * gap**2 / 2.0, gap
    noise[1, 0], noise[2, 0], noise[2, 1] = noise[0, 1], noise[0, 2], noise[1, 2]
    for j in range(len(states)):
        x, p = states[j], covariances[j]
        for a in range(3):
            x[0, a] += dt * x[1, a] + half * x[2, a]
            x[1, a] += dt * x[2, a]
        for r in range(SIZE):
            for a in range(3):
                p[r, a] += dt * p[r, 3 + a] + half * p[r, 6 + a]
                p[r, 3 + a] += dt * p[r, 6 + a]
        density = jerks[j] * jerks[j]
        for c in range(SIZE):
            for a in range(3):
                p[a, c] += dt * p[3 + a, c] + half * p[6 + a, c]
                p[3 + a, c] += dt * p[6 + a, c]
        for d in range(3):
            for e in range(3):
                for a in range(3):
                    p[3 * d + a, 3 * e + a] += density * noise[d, e]


@njit(cache=True, error_model="numpy", nogil=True)
def distances(filters, view, planes, known, sigma, widest, most):
    """Return the mean distances (D,) of 2D people from a person, in standard deviations of the innovation.

    Args:
        filters: `JointFilters`, predicted to the timestamp of the view.
        view: `ViewRays`.
        planes: (D, J, 2) undistorted normalised points.
        known: (D, J) True for detected joints.
        sigma: standard deviation of a 2D joint on the normalised plane, per axis.
        widest: (m) greatest standard deviation of an innovation. Otherwise any 2D person would fit a person
            who has not been seen for a while.
        most: greatest distance of one joint.
    """
    people, joints = known.shape
    out = np.full(people, np.inf)
    rows, rights, spread = np.empty((2, 3)), np.empty(2), np.empty((2, 2))
    for d in range(people):
        total, number = 0.0, 0
        for j in range(joints):
            if not known[d, j] or not np.isfinite(filters.states[j, 0, 0]):
                continue
            depth = ray(view, planes[d, j], filters.states[j, 0], rows, rights)
            number += 1
            if depth <= 0.0:
                total += most
                continue
            innovation(filters, j, rows, (sigma * depth) ** 2, spread)
            excess = max(1.0, 0.5 * (spread[0, 0] + spread[1, 1]) / widest**2)
            total += min(np.sqrt(0.5 * excess * square_of(rights, spread)), most)
        if number >= LEAST_JOINTS:
            out[d] = total / number
    return out


LEAST_JOINTS = 4  # minimum number of joints that a 2D person and a track have in common


@njit(cache=True, error_model="numpy", nogil=True)
def ray(view, point, position, rows, rights):
    """Write the ray of a 2D joint as rows, and the misses of a position in m; return its depth in m."""
    r, t = view.rotation, view.translation
    depth = t[2]
    for a in range(3):
        depth += r[2, a] * position[a]
    for e in range(2):
        rights[e] = t[e] - point[e] * t[2]
        for a in range(3):
            rows[e, a] = point[e] * r[2, a] - r[e, a]
            rights[e] -= rows[e, a] * position[a]
    return depth


@njit(cache=True, error_model="numpy", nogil=True)
def innovation(filters, j, rows, noise, spread):
    """Write the covariance (2, 2) m^2 of the innovation of a ray."""
    p = filters.covariances[j]
    for e in range(2):
        for f in range(2):
            spread[e, f] = noise if e == f else 0.0
            for a in range(3):
                for b in range(3):
                    spread[e, f] += rows[e, a] * p[a, b] * rows[f, b]


@njit(cache=True, error_model="numpy", nogil=True)
def square_of(vector, spread):
    """Return v' S^-1 v of a vector (2,) and a covariance (2, 2)."""
    det = spread[0, 0] * spread[1, 1] - spread[0, 1] * spread[1, 0]
    return (
        spread[1, 1] * vector[0] ** 2
        - 2.0 * spread[0, 1] * vector[0] * vector[1]
        + spread[0, 0] * vector[1] ** 2
    ) / det


@njit(cache=True, error_model="numpy", nogil=True)
def update(filters, view, plane, known, sigma):
    """Update all joints with one 2D person, in place; return the squared innovations (J,).

    An innovation is in units of its covariance, with two degrees of freedom; 0 = unknown.

    A joint that was unknown starts on its ray, at the mean depth of the other joints.

    Args:
        view, plane, known, sigma: see `distances`, of one 2D person: (J, 2) and (J,).
    """
    states, covariances, jerks = filters
    rows, rights = np.empty((2, 3)), np.empty(2)
    spread, gain = np.empty((2, 2)), np.empty((SIZE, 2))
    squares = np.zeros(len(states))
    depths, number = 0.0, 0
    for j in range(len(states)):
        if np.isfinite(states[j, 0, 0]):
            depth = view.translation[2]
            for a in range(3):
                depth += view.rotation[2, a] * states[j, 0, a]
            depths, number = depths + depth, number + 1
    for j in range(len(states)):
        if not known[j]:
            continue
        if not np.isfinite(states[j, 0, 0]):
            if number:
                start(filters, j, view, plane[j], depths / number, sigma)
            continue
        depth = ray(view, plane[j], states[j, 0], rows, rights)
        if depth <= 0.05:
            continue
        noise = (sigma * depth) ** 2
        innovation(filters, j, rows, noise, spread)
        square = 0.5 * square_of(rights, spread)
        squares[j] = 2.0 * square
        jerks[j] *= np.exp(0.5 * ADAPTATION * (min(square, MOST_EXCESS) - 1.0))
        jerks[j] = min(max(jerks[j], LEAST_JERK), MOST_JERK)
        growth = noise_growth(2.0 * square, CAUCHY)
        p = covariances[j]
        det = growth * (spread[0, 0] * spread[1, 1] - spread[0, 1] * spread[1, 0])
        for r in range(SIZE):
            first = second = 0.0
            for a in range(3):
                first += p[r, a] * rows[0, a]
                second += p[r, a] * rows[1, a]
            gain[r, 0] = (first * spread[1, 1] - second * spread[1, 0]) / det
            gain[r, 1] = (second * spread[0, 0] - first * spread[0, 1]) / det
        flat = states[j].reshape(SIZE)
        for r in range(SIZE):
            flat[r] += gain[r, 0] * rights[0] + gain[r, 1] * rights[1]
        cross = np.empty((2, SIZE))
        for c in range(SIZE):
            for e in range(2):
                cross[e, c] = 0.0
                for a in range(3):
                    cross[e, c] += rows[e, a] * p[a, c]
        for r in range(SIZE):
            for c in range(SIZE):
                p[r, c] -= gain[r, 0] * cross[0, c] + gain[r, 1] * cross[1, c]
        for r in range(SIZE):
            for c in range(r):
                p[r, c] = p[c, r] = 0.5 * (p[r, c] + p[c, r])
    return squares


@njit(cache=True, error_model="numpy", nogil=True)
def start(filters, j, view, point, depth, sigma):
    """Start joint j on the ray of a 2D joint, at a depth in m that is roughly known."""
    x, p = filters.states[j], filters.covariances[j]
    r, t = view.rotation, view.translation
    x[:], p[:] = 0.0, 0.0
    for a in range(3):
        for e in range(3):
            local = depth * point[e] if e < 2 else depth
            x[0, a] += r[e, a] * (local - t[e])
    for a in range(3):
        p[a, a] = START_DEPTH**2
        p[3 + a, 3 + a] = START_SPEED**2
        p[6 + a, 6 + a] = START_ACCELERATION**2
    filters.jerks[j] = START_JERK
