"""Joints from the 2D people of a person: choice of observations, then robust least squares.

For every joint, each view offers the joint of the 2D person that it gave to this skeleton, and, at
a penalty, the same joint of other 2D people (detectors mix people up where they overlap). Starting
points are the prediction and intersections of pairs of views; the one with the lowest truncated
cost wins. From there Gauss-Newton with Cauchy weights on the reprojection error (the objective of
Joo et al. 2017, 5.3, made robust), gated in the last steps. A prediction enters the choice of the
start, never the estimate; but a joint that two views place far from where three agreed a moment ago is
missing, as one of the two must be wrong. `geometry.triangulate_robust` is the numpy reference of the
last step.
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.kernels import njit
from panoptic_ros.solving.cameras import Cameras
from panoptic_ros.solving.gauss_newton import MIN_DEPTH, TABLE, SolverRules, refine_point
from panoptic_ros.solving.truncation import truncated

Array = np.ndarray

GOOD_COST = 3.0  # truncated cost per view (2 is expected) up to which the prediction is taken as the start
DENIED = 2.0  # standard deviations; gate of two views about a firm prediction
MANY_VIEWS = 8  # from here on a wrong place cannot be that cheap, and twice the cost is good enough


class Room(NamedTuple):
    """Arrays that `best_start` works in.

    table: (V, TABLE) observations. own: (V, 2) picks of the own 2D people, have: (V,) views that have one.
    trial, normal, residuals: a point (3,), its normal matrix (3, 3), and its residuals (V,).
    """

    table: Array
    own: Array
    have: Array
    trial: Array
    normal: Array
    residuals: Array


@njit(cache=True, error_model="numpy")
def pick_observations(x, shift, p, j, member, source, owner, plane, precision, starts, cams, rules, picks):
    """Observation of least cost in every view for the point x; returns the sum of their truncated costs.

    picks (V, 2): 2D person and joint of it, -1 where the view has none.
    """
    rotations, translations, delays = cams
    limit, penalty = rules.truncation * rules.truncation, rules.foreign_penalty
    total = 0.0
    for v in range(len(starts) - 1):
        picks[v, 0] = -1
        best = np.inf
        a = x[0] + shift[0] * delays[v]
        b = x[1] + shift[1] * delays[v]
        c = x[2] + shift[2] * delays[v]
        r = rotations[v]
        z = r[2, 0] * a + r[2, 1] * b + r[2, 2] * c + translations[v, 2]
        if z < MIN_DEPTH:
            continue
        u = (r[0, 0] * a + r[0, 1] * b + r[0, 2] * c + translations[v, 0]) / z
        w = (r[1, 0] * a + r[1, 1] * b + r[1, 2] * c + translations[v, 1]) / z
        own = member[p, v]
        if own >= 0:
            s = source[p, v, j]
            if precision[own, s] > 0.0 and (owner[own, s] < 0 or owner[own, s] == p):
                du, dw = u - plane[own, s, 0], w - plane[own, s, 1]
                best = (du * du + dw * dw) * precision[own, s] ** 2
                picks[v, 0], picks[v, 1] = own, s
        least = min(best, limit) - penalty  # what others must stay below
        if least <= 0.0:
            total += truncated(best, limit)
            continue
        for d in range(starts[v], starts[v + 1]):
            if d == own or precision[d, j] <= 0.0 or (owner[d, j] >= 0 and owner[d, j] != p):
                continue
            du, dw = u - plane[d, j, 0], w - plane[d, j, 1]
            cost = (du * du + dw * dw) * precision[d, j] ** 2
            if cost < least:
                least, best = cost, cost + penalty
                picks[v, 0], picks[v, 1] = d, j
        if best < np.inf:
            total += truncated(best, limit)
    return total


@njit(cache=True, error_model="numpy")
def intersect(first, second, picks_own, plane, cams, centres, x):
    """Middle of the shortest connection of two views' rays into x; False behind a camera or parallel."""
    rotations = cams.rotations
    rays = np.empty((2, 3))
    for k in range(2):
        v = first if k == 0 else second
        u, w = plane[picks_own[v, 0], picks_own[v, 1]]
        r = rotations[v]
        length = 0.0
        for i in range(3):
            rays[k, i] = r[0, i] * u + r[1, i] * w + r[2, i]
            length += rays[k, i] ** 2
        length = np.sqrt(length)
        for i in range(3):
            rays[k, i] /= length
    cosine = along_a = along_b = 0.0
    for i in range(3):
        offset = centres[second, i] - centres[first, i]
        cosine += rays[0, i] * rays[1, i]
        along_a += rays[0, i] * offset
        along_b += rays[1, i] * offset
    sine = 1.0 - cosine * cosine
    if sine < 1e-4:
        return False
    a = (along_a - cosine * along_b) / sine
    b = (cosine * along_a - along_b) / sine
    if a < MIN_DEPTH or b < MIN_DEPTH:
        return False
    for i in range(3):
        x[i] = 0.5 * (centres[first, i] + a * rays[0, i] + centres[second, i] + b * rays[1, i])
    return True


@njit(cache=True, error_model="numpy")
def best_start(p, j, prediction, spread, shift, member, source, owner, plane, precision, starts, cams,
               centres, rules, x, picks, scratch):  # fmt: skip
    """Choose the starting point of a joint into x, its observations into picks; the cost, inf if none.

    Candidates: the prediction (if any) after a few steps, and intersections of pairs of own views. The
    cost is truncated over the views, plus the truncated distance to the prediction.
    """
    own, have, trial = scratch.own, scratch.have, scratch.trial
    views = len(starts) - 1
    limit = rules.truncation * rules.truncation
    count = 0
    for v in range(views):
        d = member[p, v]
        if d >= 0:
            s = source[p, v, j]
            if precision[d, s] > 0.0 and (owner[d, s] < 0 or owner[d, s] == p):
                own[v, 0], own[v, 1] = d, s
                have[count] = v
                count += 1
    best = np.inf
    guided = np.isfinite(prediction[0])
    if guided:
        for i in range(3):
            trial[i] = prediction[i]
        pick_observations(trial, shift, p, j, member, source, owner, plane, precision, starts, cams,
                          rules, picks)  # fmt: skip
        if refine_point(trial, shift, picks, plane, precision, cams, rules, 3, False, scratch.normal,
                        scratch.residuals, scratch.table) >= 2:  # fmt: skip
            cost = pick_observations(trial, shift, p, j, member, source, owner, plane, precision, starts,
                                     cams, rules, picks)  # fmt: skip
            for i in range(3):
                x[i] = trial[i]
            best = cost + _prior_cost(trial, prediction, spread, limit)
            if best < (GOOD_COST if count < MANY_VIEWS else 2.0 * GOOD_COST) * count:
                return best
    step = max(1, count // 2)
    tried = 0
    while step >= 1 and tried < rules.max_pairs:
        for i in range(count):
            k = (i + step) % count
            if tried >= rules.max_pairs or k == i or (2 * step == count and i >= step):
                continue
            tried += 1
            if not intersect(have[i], have[k], own, plane, cams, centres, trial):
                continue
            cost = pick_observations(trial, shift, p, j, member, source, owner, plane, precision, starts,
                                     cams, rules, picks)  # fmt: skip
            if guided:
                cost += _prior_cost(trial, prediction, spread, limit)
            if cost < best:
                best = cost
                for i in range(3):
                    x[i] = trial[i]
        step -= 1
    if best < np.inf:
        pick_observations(x, shift, p, j, member, source, owner, plane, precision, starts, cams, rules,
                          picks)  # fmt: skip
    return best


@njit(cache=True, error_model="numpy")
def _scratch(views):
    return Room(
        np.empty((views, TABLE)), np.empty((views, 2), np.int64), np.empty(views, np.int64), np.empty(3),
        np.empty((3, 3)), np.empty(views),
    )  # fmt: skip


@njit(cache=True, error_model="numpy")
def _prior_cost(x, prediction, spread, limit):
    """Truncated squared distance to the prediction in units of its spread."""
    squared = (x[0] - prediction[0]) ** 2 + (x[1] - prediction[1]) ** 2 + (x[2] - prediction[2]) ** 2
    return truncated(squared / (spread * spread), limit)


def solve_joints(
    todo: Array, predictions: Array, spreads: Array, shifts: Array, firm: Array, member: Array, source: Array,
    owner: Array, plane: Array, precision: Array, starts: Array, cams: Cameras,
    centres: Array, rules: SolverRules,
) -> tuple[Array, Array, Array, Array, Array]:  # fmt: skip
    """Solve the joints `todo` (P, J) of all people.

    Args:
        predictions: (P, J, 3) m, NaN = none; spreads: (P, J) m; shifts: (P, J, 3) m/s, velocities.
        firm: (P, J) whether the prediction can reject what two views say.
        member: (P, V) the 2D person of each view, -1 = none. source: (P, V, J) joint of that person.
        owner: (D, J) person that has claimed an observation, -1 = free; others may not use it.
        centres: (V, 3) m, of the cameras.

    Returns:
        positions (P, J, 3), normals (P, J, 3, 3) 1/m^2, residuals (P, J, V) in sigmas (-1 = unused),
        picks (P, J, V, 2), costs (P, J); NaN positions where fewer than two views agree.
    """
    shape = (*todo.shape, len(starts) - 1)
    positions, costs = np.full((*todo.shape, 3), np.nan), np.full(todo.shape, np.inf)
    normals, residuals = np.zeros((*todo.shape, 3, 3)), np.full(shape, -1.0)
    picks = np.full((*shape, 2), -1, np.int64)
    solve_again(todo, predictions, spreads, shifts, firm, member, source, owner, plane, precision, starts,
                cams, centres, rules, positions, normals, residuals, picks, costs)  # fmt: skip
    return positions, normals, residuals, picks, costs


@njit(cache=True, error_model="numpy")
def solve_again(todo, predictions, spreads, shifts, firm, member, source, owner, plane, precision, starts,
                cams, centres, rules, positions, normals, residuals, picks, costs):  # fmt: skip
    """The same, in place: replaces the earlier results of the joints `todo`."""
    people, joints = todo.shape
    views = len(starts) - 1
    x, scratch = np.empty(3), _scratch(views)
    for p in range(people):
        for j in range(joints):
            if not todo[p, j]:
                continue
            shift, pick = shifts[p, j], picks[p, j]
            positions[p, j], normals[p, j], residuals[p, j], costs[p, j] = np.nan, 0.0, -1.0, np.inf
            cost = best_start(p, j, predictions[p, j], spreads[p, j], shift, member, source, owner, plane,
                              precision, starts, cams, centres, rules, x, pick, scratch)  # fmt: skip
            if cost == np.inf:
                pick[:] = -1
                continue
            refine_point(x, shift, pick, plane, precision, cams, rules, 4, False, normals[p, j],
                         residuals[p, j], scratch.table)  # fmt: skip
            costs[p, j] = pick_observations(x, shift, p, j, member, source, owner, plane, precision, starts,
                                            cams, rules, pick)  # fmt: skip
            count = refine_point(x, shift, pick, plane, precision, cams, rules, 6, True, normals[p, j],
                                 residuals[p, j], scratch.table)  # fmt: skip
            if count == 2 and firm[p, j]:
                away = _prior_cost(x, predictions[p, j], spreads[p, j], np.inf)
                if away > DENIED * DENIED:
                    residuals[p, j] = -1.0
                    continue
            if count >= 2:
                for i in range(3):
                    positions[p, j, i] = x[i]
