"""Detection of artefacts among the 2D joints of people who are cut by an image border.

A joint outside the image cannot be visible in it. Detectors report it inside all the same, often 50 px from
its true position, and with little less confidence. The other joints of a cut person are as accurate as those
of any person.

So every 2D joint of a cut person is either an observation or an artefact. An observation scatters with its
noise about the projection of the joint, and this projection is inside the image. An artefact scatters with a
share of the person's size about a projection outside the image. The more probable case counts.

The projection uses the position of the joint from the other views and the prediction, without the view
itself. Otherwise a view that no other view checks would pull the joint into its image, and no residual would
show it.
"""

from __future__ import annotations

import math

import numpy as np

from panoptic_ros.geometry.robust import noise_growth
from panoptic_ros.geometry.symmetric import invert_symmetric
from panoptic_ros.kernels import njit
from panoptic_ros.solving.joint_records import PersonCandidates, SolvedJoints
from panoptic_ros.solving.joints import MISPLACED
from panoptic_ros.solving.scene import MIN_DEPTH, SceneObservations, inside_by, is_outside, seen_at

Array = np.ndarray

# log odds of an artefact: constant, coefficient of the score, coefficient of ln(distance from the border /
# size of the 2D pose). Logistic regression over 17,000 joints of cut people in three captures
ODDS = (-4.0, -5.5, -1.8)
SHARES = (0.005, 1.0)  # limits of distance / size in the regression
PRIOR = 2.0  # factor on the standard deviation of predictions, because their errors persist


def border_odds(found: PersonCandidates, seen: SceneObservations, scores: Array) -> Array:
    """Return the prior odds (D, J) that 2D joints are artefacts of a border, from one image alone.

    The odds are 0 unless the first estimate or the prediction of the person has joints outside the image.

    Args:
        scores: (D, J) of the 2D joints.
    """
    guide = found.guide
    places = np.where(np.isfinite(guide.positions), guide.positions, found.places)
    odds: Array = odds_of(places, guide.shifts, found.member, seen, scores)
    return odds


@njit(cache=True, error_model="numpy")
def odds_of(places, shifts, member, seen, scores):
    """Return prior odds (D, J) that 2D joints are artefacts of a border; compiled part of `border_odds`.

    Args:
        places: (P, J, 3) m, world, joints of the people.
        shifts: (P, J, 3) m/s, their velocities.
        member: (P, V) row of each person's 2D pose, -1 = none.
        seen: `SceneObservations`.
        scores: (D, J) of the 2D joints.
    """
    odds = np.zeros(scores.shape)
    for p in range(member.shape[0]):
        for v in range(member.shape[1]):
            d, camera = member[p, v], seen.lenses[v]
            if d < 0 or not _is_cut(places[p], shifts[p], seen.cams, camera, v):
                continue
            size = max(seen.sizes[d] * camera.fx, 1.0)
            for j in range(scores.shape[1]):
                if scores[d, j] > 0.0:
                    gap = inside_by(camera, seen.plane[d, j, 0], seen.plane[d, j, 1]) / size
                    if gap < 0.0:  # outside the image: the detector extrapolates an observation
                        continue
                    share = math.log(min(max(gap, SHARES[0]), SHARES[1]))
                    odds[d, j] = math.exp(ODDS[0] + ODDS[1] * scores[d, j] + ODDS[2] * share)
    return odds


def artefacts(
    solved: SolvedJoints, found: PersonCandidates, seen: SceneObservations, odds: Array, cauchy: float
) -> Array:
    """Return a mask (D, J) of the 2D joints that are artefacts of a border.

    Args:
        solved: Joints of all people, solved with all observations.
        odds: See `border_odds`.
        cauchy: Scale of the Cauchy weights of that solution, in standard deviations.
    """
    guide = found.guide
    expected, members = (guide.positions, guide.spreads, guide.shifts), (found.member, found.source)
    marks: Array = mark_artefacts(solved, expected, members, seen, odds, cauchy)
    return marks


@njit(cache=True, error_model="numpy")
def mark_artefacts(solved, expected, members, seen, odds, cauchy):
    """Return a mask (D, J) of the 2D joints that are artefacts of a border; compiled part of `artefacts`.

    Args:
        expected: Positions (P, J, 3) m, spreads (P, J) m and velocities (P, J, 3) m/s of `JointPredictions`.
        members: `member` (P, V) and `source` (P, V, J) of `PersonCandidates`.
    """
    positions, normals, residuals, picks = solved
    (guesses, spreads, shifts), (member, source) = expected, members
    people, joints, views = residuals.shape
    marks = np.zeros(seen.precision.shape, np.bool_)
    if not odds.any():
        return marks
    lower, spread = np.zeros((3, 3)), np.zeros((3, 3))
    rows, x, step = np.empty((2, 3)), np.empty(3), np.empty(3)
    for p in range(people):
        for v in range(views):
            if member[p, v] < 0 or not np.any(odds[member[p, v]] > 0.0):
                continue
            if not _is_cut(positions[p], shifts[p], seen.cams, seen.lenses[v], v):
                continue
            camera, size = seen.lenses[v], seen.sizes[member[p, v]]
            for j in range(joints):
                used = residuals[p, j, v] >= 0.0
                d, s = (picks[p, j, v, 0], picks[p, j, v, 1]) if used else (member[p, v], source[p, v, j])
                known = seen.precision[d, s] > 0.0 and np.isfinite(positions[p, j, 0])
                if not known or odds[d, s] == 0.0:
                    continue
                late = seen.delays[d, s]
                u, w, z = seen_at(seen.cams, v, positions[p, j], shifts[p, j], late)
                if z <= MIN_DEPTH:
                    continue
                information = seen.precision[d, s] ** 2
                weight = information / noise_growth(residuals[p, j, v] ** 2, cauchy) if used else 0.0
                _jacobian(seen.cams.rotations[v], u, w, z, rows)
                du, dw = seen.plane[d, s, 0] - u, seen.plane[d, s, 1] - w
                for i in range(3):
                    step[i] = -weight * (rows[0, i] * du + rows[1, i] * dw)
                    for k in range(i + 1):
                        lower[i, k] = normals[p, j, i, k]
                        lower[i, k] -= weight * (rows[0, i] * rows[0, k] + rows[1, i] * rows[1, k])
                if np.isfinite(guesses[p, j, 0]):
                    weight = 1.0 / (PRIOR * spreads[p, j]) ** 2
                    for i in range(3):
                        lower[i, i] += weight
                        step[i] += weight * (guesses[p, j, i] - positions[p, j, i])
                else:
                    for i in range(3):
                        lower[i, i] += 1.0  # 1/m^2, weak prior: the joint is within about 1 m
                invert_symmetric(lower, 1.0, spread)
                for i in range(3):
                    x[i] = positions[p, j, i]
                    for k in range(3):
                        x[i] += spread[i, k] * step[k]
                u, w, z = seen_at(seen.cams, v, x, shifts[p, j], late)
                if z <= MIN_DEPTH:
                    continue
                _jacobian(seen.cams.rotations[v], u, w, z, rows)
                a = b = c = 0.0
                for i in range(3):
                    for k in range(3):
                        a += rows[0, i] * spread[i, k] * rows[0, k]
                        b += rows[0, i] * spread[i, k] * rows[1, k]
                        c += rows[1, i] * spread[i, k] * rows[1, k]
                outside = _outside(camera, u, w, a, c)
                du, dw = seen.plane[d, s, 0] - u, seen.plane[d, s, 1] - w
                observed = _density(du, dw, a + 1.0 / information, b, c + 1.0 / information)
                broad = (MISPLACED * size) ** 2
                guessed = _density(du, dw, a + broad, b, c + broad)
                if outside * guessed * odds[d, s] > (1.0 - outside) * observed:
                    marks[d, s] = True
    return marks


@njit(cache=True, error_model="numpy")
def _is_cut(position, shift, cams, camera, v):
    """Return whether a joint of a person (J, 3) m projects outside the image of view v."""
    for j in range(len(position)):
        x, y, z = seen_at(cams, v, position[j], shift[j], cams.delays[v])
        if z > MIN_DEPTH and is_outside(camera, x, y):
            return True
    return False


@njit(cache=True, error_model="numpy")
def _jacobian(rotation, u, w, z, rows):
    """Write the derivative (2, 3) 1/m of the projection on the plane with respect to the point to `rows`."""
    for i in range(3):
        rows[0, i] = (rotation[0, i] - u * rotation[2, i]) / z
        rows[1, i] = (rotation[1, i] - w * rotation[2, i]) / z


@njit(cache=True, error_model="numpy")
def _outside(camera, u, w, a, c):
    """Return the probability that a point (u, w) of the plane lies outside the image.

    Args:
        a, c: Variances of u and w.
    """
    gap = inside_by(camera, u, w)
    if not np.isfinite(gap):
        return 1.0
    deviation = max(camera.fx * np.sqrt(max(a, c)), 1e-9)
    return 0.5 * math.erfc(gap / deviation / math.sqrt(2.0))


@njit(cache=True, error_model="numpy")
def _density(du, dw, a, b, c):
    """Return the density at (du, dw) of a 2D normal distribution with covariance [[a, b], [b, c]]."""
    determinant = max(a * c - b * b, 1e-30)
    square = (c * du * du - 2.0 * b * du * dw + a * dw * dw) / determinant
    return math.exp(-0.5 * min(square, 700.0)) / (2.0 * math.pi * math.sqrt(determinant))
