"""Solves joints from the 2D poses of each person: choice of observations, then robust least squares.

For every joint, each view offers the 2D joint of the 2D pose that association gave to this person. At a
penalty, it also offers the same joint of other 2D poses, because detectors confuse people who overlap.
Starting points are the prediction and intersections of pairs of views. The one with the lowest truncated cost
is used. Then Gauss-Newton minimises the reprojection error, which is the objective of Joo et al. 2017, 5.3.
Cauchy weights and a gate in the last steps make it robust.

A prediction influences the choice of the start, never the estimate. But a joint that only two views support,
far from a position on which three views agreed recently, is treated as missing: one of the two views must be
wrong. `geometry.triangulate_robust` is the numpy reference of the last step.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.geometry.robust import truncated
from panoptic_ros.kernels import inlined, njit
from panoptic_ros.solving.joint_records import JointAssignment, PersonCandidates, SolvedJoints
from panoptic_ros.solving.scene import MIN_DEPTH, SceneObservations, is_outside, seen_at
from panoptic_ros.solving.triangulation import (
    TABLE,
    IterationLimit,
    PointSolution,
    SolverRules,
    intersect,
    refine_point,
)

Array = np.ndarray

GOOD_COST = 3.0  # truncated cost per view (2 is expected) below which the prediction is the start
DENIED = 2.0  # standard deviations of a firm prediction, gate for joints that only two views support
MANY_VIEWS = 8  # views from which twice GOOD_COST is accepted: no wrong position is that cheap in all of them
# share of a 2D pose's size, standard deviation of border artefacts; measured medians .09-.15, rms .15-.23
MISPLACED = 0.15
FITS = 4.0  # squared standard deviations, residual up to which a 2D joint is not an artefact
GUIDED_STEPS, ROUGH_STEPS, LAST_STEPS = 3, 4, 6  # greatest numbers of Gauss-Newton steps


class _JointPrediction(NamedTuple):
    """One joint of one person, with its prediction.

    Args:
        person: Row of the person.
        number: Index of the joint.
        expected: (3,) m, world, predicted position, NaN = none.
        spread: m, standard deviation of `expected`.
        shift: (3,) m/s, velocity.
    """

    person: int
    number: int
    expected: Array
    spread: float
    shift: Array


class _JointWorkspace(NamedTuple):
    """Work arrays for one joint.

    Args:
        x: (3,) m, world, position of the joint.
        picks: (V, 2) chosen observations: row of the 2D pose and index of its joint, -1 = none.
        own: (V, 2) the same for the person's own 2D poses.
        have: (V,) views in which the person's own 2D pose shows the joint.
        trial: (3,) m, world, position that is being tried.
    """

    x: Array
    picks: Array
    own: Array
    have: Array
    trial: Array


@inlined
def artefact_cost(squared, precision, size):
    """Return the cost of a 2D joint that a detector reports although the joint lies outside the image.

    The cost is -2 log likelihood, relative to that of an observation without error. Artefacts scatter about
    the projection of the joint with a standard deviation of MISPLACED times the size of the 2D pose. All
    quantities refer to the plane at 1 m.

    Args:
        squared: Squared distance from the projection.
        precision: 1 / standard deviation of observations.
        size: Size of the 2D pose; infinite = artefacts are excluded.
    """
    spread = max(MISPLACED * size * precision, 1.0)  # in standard deviations of an observation
    return 4.0 * np.log(spread) + squared * (precision / spread) ** 2


@njit(cache=True, error_model="numpy")
def pick_observations(x, joint, claims, seen, rules, picks):
    """Choose the observation of least cost in every view for the point x; return the sum of truncated costs.

    Args:
        x: (3,) m, world.
        joint: `_JointPrediction`.
        claims: `JointAssignment`.
        seen: `SceneObservations`.
        rules: `SolverRules`.
        picks: (V, 2) output, row of the 2D pose and index of its joint. The row is -1 where the view has
            none. It is also -1 where x projects outside the image and the view's own 2D joint is more likely
            an artefact.
    """
    member, source, owner = claims
    plane, precision, p, j = seen.plane, seen.precision, joint.person, joint.number
    limit, penalty = rules.truncation * rules.truncation, rules.foreign_penalty
    total = 0.0
    for v in range(len(picks)):
        picks[v, 0] = -1
        best = np.inf
        late = seen.cams.delays[v]
        u, w, depth = seen_at(seen.cams, v, x, joint.shift, late)
        if depth <= MIN_DEPTH:
            continue
        own = member[p, v]
        if own >= 0:
            s = source[p, v, j]
            if precision[own, s] > 0.0 and (owner[own, s] < 0 or owner[own, s] == p):
                if seen.delays[own, s] != late:
                    late = seen.delays[own, s]
                    u, w, _ = seen_at(seen.cams, v, x, joint.shift, late)
                du, dw = u - plane[own, s, 0], w - plane[own, s, 1]
                squared = du * du + dw * dw
                best = squared * precision[own, s] ** 2
                if best > FITS and is_outside(seen.lenses[v], u, w):
                    cost = artefact_cost(squared, precision[own, s], seen.sizes[own])
                    x_own, y_own = plane[own, s, 0], plane[own, s, 1]
                    if best > cost and not is_outside(seen.lenses[v], x_own, y_own):
                        total += min(cost, limit)
                        continue
                picks[v, 0], picks[v, 1] = own, s
        least = min(best, limit) - penalty  # the cost of other 2D poses, without the penalty, must be lower
        if least <= 0.0:
            total += truncated(best, limit)
            continue
        for d in range(seen.starts[v], seen.starts[v + 1]):
            if d == own or precision[d, j] <= 0.0 or (owner[d, j] >= 0 and owner[d, j] != p):
                continue
            if seen.delays[d, j] != late:
                late = seen.delays[d, j]
                u, w, _ = seen_at(seen.cams, v, x, joint.shift, late)
            du, dw = u - plane[d, j, 0], w - plane[d, j, 1]
            cost = (du * du + dw * dw) * precision[d, j] ** 2
            if cost < least:
                least, best = cost, cost + penalty
                picks[v, 0], picks[v, 1] = d, j
        if best < np.inf:
            total += truncated(best, limit)
    return total


@njit(cache=True, error_model="numpy")
def start_from_prediction(joint, claims, seen, rules, room, result):
    """Refine the predicted position, choose observations there, and return the cost.

    The position and the observations are written to the room.

    Returns:
        the cost over the views plus the truncated distance to the prediction; infinite with fewer than two
        views.
    """
    x, picks = room.x, room.picks
    for i in range(3):
        x[i] = joint.expected[i]
    pick_observations(x, joint, claims, seen, rules, picks)
    if refine_point(x, joint.shift, picks, seen, rules, IterationLimit(GUIDED_STEPS, False), result) < 2:
        return np.inf
    cost = pick_observations(x, joint, claims, seen, rules, picks)
    return cost + _prior_cost(x, joint, rules.truncation**2)


@njit(cache=True, error_model="numpy")
def start_from_pairs(joint, claims, seen, rules, room, best):
    """Find the cheapest intersection of two of the person's own rays, and return its cost.

    Pairs of distant entries in the list of views come first, so that they cover the whole rig. At most
    `rules.max_pairs` pairs are tried. If a pair costs less than `best`, its intersection is written to
    `room.x`.

    Returns:
        the least cost, which is `best` if no pair costs less.
    """
    count = _own_views(joint, claims, seen, room)
    step, tried = max(1, count // 2), 0
    while step >= 1 and tried < rules.max_pairs:
        for i in range(count):
            k = (i + step) % count
            if tried >= rules.max_pairs or k == i or (2 * step == count and i >= step):
                continue
            tried += 1
            if not intersect(room.have[i], room.have[k], room.own, seen, room.trial):
                continue
            cost = pick_observations(room.trial, joint, claims, seen, rules, room.picks)
            if np.isfinite(joint.expected[0]):
                cost += _prior_cost(room.trial, joint, rules.truncation**2)
            if cost < best:
                best = cost
                for i in range(3):
                    room.x[i] = room.trial[i]
        step -= 1
    return best


@njit(cache=True, error_model="numpy")
def _own_views(joint, claims, seen, room):
    """Write the person's own 2D joints and their views to the room, and return the number of views."""
    count = 0
    for v in range(len(room.own)):
        d = claims.member[joint.person, v]
        if d >= 0:
            s = claims.source[joint.person, v, joint.number]
            if seen.precision[d, s] > 0.0 and (claims.owner[d, s] < 0 or claims.owner[d, s] == joint.person):
                room.own[v, 0], room.own[v, 1] = d, s
                room.have[count] = v
                count += 1
    return count


@njit(cache=True, error_model="numpy")
def _prior_cost(x, joint, limit):
    """Return the squared distance of x to the prediction in units of its variance, truncated at `limit`."""
    expected = joint.expected
    squared = (x[0] - expected[0]) ** 2 + (x[1] - expected[1]) ** 2 + (x[2] - expected[2]) ** 2
    return truncated(squared / (joint.spread * joint.spread), limit)


def solve_joints(found: PersonCandidates, seen: SceneObservations, rules: SolverRules) -> SolvedJoints:
    """Solve all joints of all people, and assign each 2D joint to at most one person."""
    people, joints = found.guide.spreads.shape
    solved = SolvedJoints.nothing(people, joints, len(seen.starts) - 1)
    claims = JointAssignment(found.member, found.source, np.full(seen.precision.shape, -1, np.int64))
    _solve_and_settle(np.ones((people, joints), bool), found, claims, seen, rules, solved)
    return solved


def solve_without(
    wrong: Array, solved: SolvedJoints, found: PersonCandidates, seen: SceneObservations, rules: SolverRules
) -> None:
    """Solve the joints that depend on wrong 2D joints again, and replace them in `solved`.

    The wrong 2D joints get precision 0 in `seen.precision`. All other joints keep their 2D joints, unless a
    2D joint fits a newly solved joint better.

    Args:
        wrong: (D, J) bool, 2D joints to exclude.
    """
    seen.precision[wrong] = 0.0
    claims = JointAssignment(found.member, found.source, np.full(seen.precision.shape, -1, np.int64))
    todo = claim_right(wrong, claims, solved)
    _solve_and_settle(todo, found, claims, seen, rules, solved)


@njit(cache=True, error_model="numpy")
def claim_right(wrong, claims, solved):
    """Return a mask (P, J) of the joints that depend on wrong 2D joints (D, J).

    For all other joints, enter the person as owner of the 2D joints used, in `claims.owner`. A joint depends
    on a wrong 2D joint if the person's own 2D pose offers it, or if the solution used it.
    """
    member, source, owner = claims
    people, joints, views = solved.residuals.shape
    todo = np.zeros((people, joints), np.bool_)
    for p in range(people):
        for j in range(joints):
            for v in range(views):
                own, used = member[p, v], solved.residuals[p, j, v] >= 0.0
                todo[p, j] |= own >= 0 and wrong[own, source[p, v, j]]
                todo[p, j] |= used and wrong[solved.picks[p, j, v, 0], solved.picks[p, j, v, 1]]
            if todo[p, j]:
                continue
            for v in range(views):
                if solved.residuals[p, j, v] >= 0.0:
                    owner[solved.picks[p, j, v, 0], solved.picks[p, j, v, 1]] = p
    return todo


def compile_claims() -> None:
    """Compile `claim_right`, which runs only for people whom an image border cuts."""
    member, source = np.full((1, 1), -1, np.int64), np.zeros((1, 1, 1), np.int64)
    claims = JointAssignment(member, source, np.full((1, 1), -1, np.int64))
    claim_right(np.zeros((1, 1), bool), claims, SolvedJoints.nothing(1, 1, 1))


def _solve_and_settle(
    todo: Array,
    found: PersonCandidates,
    claims: JointAssignment,
    seen: SceneObservations,
    rules: SolverRules,
    solved: SolvedJoints,
) -> None:
    """Solve the joints `todo` (P, J), and write the results to `solved`.

    Joints that lose a 2D joint to another person are then solved again.
    """
    solve_again(todo, found.guide, claims, seen, rules, solved, False)
    losers = settle(solved, claims, rules.foreign_penalty)
    if losers.any():
        solve_again(losers, found.guide, claims, seen, rules, solved, True)


@njit(cache=True, error_model="numpy")
def solve_again(todo, guides, claims, seen, rules, solved, claiming):
    """Solve the joints `todo` (P, J), and replace their results in `solved`.

    Args:
        claiming: whether each joint claims its 2D joints before the next one is solved.
    """
    views = len(seen.starts) - 1
    x, trial, table = np.empty(3), np.empty(3), np.empty((views, TABLE))
    own, have = np.empty((views, 2), np.int64), np.empty(views, np.int64)
    for p in range(todo.shape[0]):
        for j in range(todo.shape[1]):
            if not todo[p, j]:
                continue
            joint = _JointPrediction(p, j, guides.positions[p, j], guides.spreads[p, j], guides.shifts[p, j])
            pick = solved.picks[p, j]
            room = _JointWorkspace(x, pick, own, have, trial)
            result = PointSolution(solved.normals[p, j], solved.residuals[p, j], table)
            for i in range(3):
                solved.positions[p, j, i] = np.nan
            if _start(joint, claims, seen, rules, room, result) == np.inf:
                _forget(pick, result)
                continue
            count = refine_point(x, joint.shift, pick, seen, rules, IterationLimit(LAST_STEPS, True), result)
            firm = guides.firm[p, j]
            if count < 2 or (count == 2 and firm and _prior_cost(x, joint, np.inf) > DENIED * DENIED):
                _forget(pick, result)
                continue
            for i in range(3):
                solved.positions[p, j, i] = x[i]
            if not claiming:
                continue
            for v in range(views):
                if result.residuals[v] >= 0.0:
                    claims.owner[pick[v, 0], pick[v, 1]] = p


@njit(cache=True, error_model="numpy")
def _start(joint, claims, seen, rules, room, result):
    """Write the starting point and the observations of a joint to the room, and return the cost.

    Candidates are the prediction (if any), refined by a few steps, and intersections of pairs of the person's
    own rays. They are compared by the truncated cost over the views, plus the truncated distance to the
    prediction. A prediction with a low cost is accepted without trying pairs. Otherwise the best candidate is
    refined.

    Returns:
        the cost, infinite if there is no start.
    """
    x, picks, best = room.x, room.picks, np.inf
    if np.isfinite(joint.expected[0]):
        best = start_from_prediction(joint, claims, seen, rules, room, result)
        count = _own_views(joint, claims, seen, room)
        if best < (GOOD_COST if count < MANY_VIEWS else 2.0 * GOOD_COST) * count:
            return best
    best = start_from_pairs(joint, claims, seen, rules, room, best)
    if best < np.inf:
        pick_observations(x, joint, claims, seen, rules, picks)
        refine_point(x, joint.shift, picks, seen, rules, IterationLimit(ROUGH_STEPS, False), result)
        best = pick_observations(x, joint, claims, seen, rules, picks)
    return best


@njit(cache=True, error_model="numpy")
def _forget(picks, result):
    """Clear the observations, residuals and normal matrix of a joint that could not be solved."""
    for v in range(len(picks)):
        picks[v, 0] = picks[v, 1] = -1
        result.residuals[v] = -1.0
    for i in range(3):
        for k in range(3):
            result.normal[i, k] = 0.0


@njit(cache=True, error_model="numpy")
def settle(solved, claims, penalty):
    """Assign every 2D joint to the person whose joint fits it best, in `claims.owner`.

    A 2D detection may support only one skeleton (Joo et al. 2017, 5.3).

    Args:
        solved: `SolvedJoints`.
        claims: `JointAssignment`; `owner` is updated.
        penalty: Cost of a 2D joint of another person's 2D pose, in squared standard deviations.

    Returns:
        (P, J) joints that lost a 2D joint to another person.
    """
    residuals, picks, owner = solved.residuals, solved.picks, claims.owner
    people, joints, views = residuals.shape
    least = np.full(owner.shape, np.inf)
    for p in range(people):
        for j in range(joints):
            for v in range(views):
                if residuals[p, j, v] >= 0.0:
                    d, s = picks[p, j, v]
                    cost = residuals[p, j, v] ** 2 + (penalty if claims.member[p, v] != d else 0.0)
                    if cost < least[d, s]:
                        least[d, s], owner[d, s] = cost, p
    losers = np.zeros((people, joints), np.bool_)
    for p in range(people):
        for j in range(joints):
            for v in range(views):
                if residuals[p, j, v] >= 0.0 and owner[picks[p, j, v, 0], picks[p, j, v, 1]] != p:
                    losers[p, j] = True
    return losers
