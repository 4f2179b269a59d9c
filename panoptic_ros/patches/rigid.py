"""Motion of a rigid part from points on it in two images of every view: robust Gauss-Newton, compiled.

It replaces Kabsch's fit to triangulated patches (Joo et al. 2017, 6.3). The residuals are those of the
images, so a point that only one view tracks counts too, in the two directions that it measures. The
covariance of the motion follows from those of the 2D tracks. Depths need only be known roughly: a relative
error of the depth changes the motion in the point's own image by the same share.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.geometry.robust import noise_growth
from panoptic_ros.geometry.rotations import rotation_of, vector_of
from panoptic_ros.kernels import njit

Array = np.ndarray
ROUNDS = 8
CAUCHY = 2.0  # standard deviations, scale of the Cauchy weight
SETTLED = 1e-5  # m and rad, step below which the iteration ends
FREEDOM = 6  # number of parameters of a motion
AGREES = 9.0  # squared standard deviations, greatest residual of a track that agrees with the motion


class PointTracks(NamedTuple):
    """N 2D tracks, ordered by part."""

    points: Array  # (N, 3) m, at the first instant
    cameras: Array  # (N,) index into the cameras
    targets: Array  # (N, 2) on the plane at distance 1, at the second instant
    information: Array  # (N, 3) xx, xy, yy on that plane
    others: Array  # (N,) squared residual, in variances, under the best other motion; see `misses`


class PartSolution(NamedTuple):
    """Motions of M parts."""

    motions: Array  # (M, 6) rotation vector rad and translation m
    covariances: Array  # (M, 6, 6) of a small world rotation, multiplied from the left, and translation
    agreeing: Array  # (M,) number of tracks that agree
    spreads: Array  # (M,) root mean square of their residuals, in standard deviations


class PartProblems(NamedTuple):
    """M parts to solve for."""

    starts: Array  # (M + 1,) first track of each part
    centres: Array  # (M, 3) m, centres of rotation: translations are those of these points
    guesses: Array  # (M, G, 6) motions; the search starts from the best. The first is the expected one


class _NormalEquations(NamedTuple):
    """Rotation (3, 3) of a part at a motion, and the normal equations (6, 6) and (6,)."""

    rotation: Array
    normal: Array
    gradient: Array


def solved(
    tracks: PointTracks, bodies: PartProblems, which: Array, views: Array, spread: Array, result: PartSolution
) -> None:
    """Solve for the motions of some parts, into `result`.

    Args:
        tracks: The 2D tracks.
        bodies: The parts.
        which: Rows of the parts to solve for.
        views: (V, 3, 4) cam_from_world.
        spread: (6,) standard deviation of motions from the expected one.
        result: Output, see `unsolved`.
    """
    _solve(tracks, bodies, which, views, 1.0 / spread**2, result)


def unsolved(count: int) -> PartSolution:
    """Return a result for `count` parts, none of which has a motion yet."""
    return PartSolution(
        np.zeros((count, 6)), np.zeros((count, 6, 6)), np.zeros(count, np.int32), np.zeros(count)
    )


@njit(cache=True, error_model="numpy", nogil=True)
def _solve(tracks, bodies, which, views, priors, result):
    guesses, sums = bodies.guesses, _NormalEquations(np.empty((3, 3)), np.empty((6, 6)), np.empty(6))
    rotation, normal, gradient = sums
    turn, trial, step = np.empty((3, 3)), np.empty(6), np.empty(6)
    for part in which:
        motion = result.motions[part]
        expected, best = guesses[part, 0], np.inf
        for guess in range(guesses.shape[1]):
            trial[:] = guesses[part, guess]
            cost = _accumulate(tracks, bodies, part, trial, views, sums, result)
            if cost < best:
                best = cost
                motion[:] = trial
        for _ in range(ROUNDS):
            _accumulate(tracks, bodies, part, motion, views, sums, result)
            for i in range(6):
                normal[i, i] += priors[i]
                gradient[i] -= priors[i] * (motion[i] - expected[i])
            step[:] = np.linalg.solve(normal, gradient)
            trial[:3] = step[:3]
            rotation_of(trial[:3], turn)
            vector_of(turn @ rotation, motion[:3])
            motion[3:] += step[3:]
            if np.abs(step).max() < SETTLED:
                break
        _accumulate(tracks, bodies, part, motion, views, sums, result)
        # Scale the covariance by the variance of the residuals. The motion has absorbed six residuals; they
        # count with their prior variance of 1.
        found = max(result.agreeing[part], 1)
        normal /= result.spreads[part] ** 2 + 0.5 * FREEDOM / found
        for i in range(FREEDOM):
            normal[i, i] += priors[i]
        result.covariances[part] = np.linalg.inv(normal)


@njit(cache=True, error_model="numpy", nogil=True)
def _accumulate(tracks, bodies, part, motion, views, sums, result):
    """Compute the normal equations of a part at a motion into `sums`, and return the cost.

    The number and the spread of the agreeing tracks are written to `result`.
    """
    first, last, centre = bodies.starts[part], bodies.starts[part + 1], bodies.centres[part]
    rotation, normal, gradient = sums
    rotation_of(motion[:3], rotation)
    normal[:], gradient[:] = 0.0, 0.0
    arm, ahead, residual, rows = np.empty(3), np.empty(3), np.empty(2), np.empty((2, 6))
    cost, square, agreeing = 0.0, 0.0, 0
    for n in range(first, last):
        view, point = views[tracks.cameras[n]], tracks.points[n]
        for i in range(3):
            arm[i] = 0.0
            for k in range(3):
                arm[i] += rotation[i, k] * (point[k] - centre[k])
        for i in range(3):
            ahead[i] = view[i, 3]
            for k in range(3):
                ahead[i] += view[i, k] * (centre[k] + motion[3 + k] + arm[k])
        if ahead[2] < 1e-3:
            continue
        for i in range(2):
            slope = ahead[i] / ahead[2]
            residual[i] = tracks.targets[n, i] - slope
            for k in range(3):
                rows[i, 3 + k] = (view[i, k] - slope * view[2, k]) / ahead[2]
            # d/d omega of (omega x arm) . row = (arm x row) . omega
            rows[i, 0] = arm[1] * rows[i, 5] - arm[2] * rows[i, 4]
            rows[i, 1] = arm[2] * rows[i, 3] - arm[0] * rows[i, 5]
            rows[i, 2] = arm[0] * rows[i, 4] - arm[1] * rows[i, 3]
        a, b, c = tracks.information[n, 0], tracks.information[n, 1], tracks.information[n, 2]
        whitened = a * residual[0] ** 2 + 2.0 * b * residual[0] * residual[1] + c * residual[1] ** 2
        growth = noise_growth(whitened, CAUCHY)
        cost += np.log(growth)
        other = noise_growth(tracks.others[n], CAUCHY)
        growth *= max(1.0, 0.5 * (1.0 + (growth / other) ** 2))  # the track fits another motion better
        if whitened < AGREES:
            agreeing += 1
            square += 0.5 * whitened
        a, b, c = a / growth, b / growth, c / growth
        for i in range(6):
            along, across = a * rows[0, i] + b * rows[1, i], b * rows[0, i] + c * rows[1, i]
            gradient[i] += along * residual[0] + across * residual[1]
            for k in range(6):
                normal[i, k] += along * rows[0, k] + across * rows[1, k]
    result.agreeing[part] = agreeing
    result.spreads[part] = np.sqrt(square / max(agreeing, 1))
    return cost


@njit(cache=True, error_model="numpy", nogil=True)
def misses(tracks, first, last, centre, motion, views, least):
    """Lower `least` (N,) to the squared residuals, in variances, of tracks under a motion (6,).

    Args:
        first, last: Range of the tracks.
        centre: (3,) m, centre of rotation of the motion.
        views: (V, 3, 4) cam_from_world.
    """
    rotation, ahead = np.empty((3, 3)), np.empty(3)
    rotation_of(motion[:3], rotation)
    for n in range(first, last):
        view, point = views[tracks.cameras[n]], tracks.points[n]
        for i in range(3):
            ahead[i] = view[i, 3]
            for k in range(3):
                place = centre[k] + motion[3 + k]
                for m in range(3):
                    place += rotation[k, m] * (point[m] - centre[m])
                ahead[i] += view[i, k] * place
        if ahead[2] < 1e-3:
            continue
        x = tracks.targets[n, 0] - ahead[0] / ahead[2]
        y = tracks.targets[n, 1] - ahead[1] / ahead[2]
        information = tracks.information[n]
        missed = information[0] * x * x + 2.0 * information[1] * x * y + information[2] * y * y
        least[n] = min(least[n], missed)
