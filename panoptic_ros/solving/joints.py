"""Joints from the 2D people of a person: choice of observations, then robust least squares.

For every joint, each view offers the joint of the 2D person that association gave to this person, and, at
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

from panoptic_ros.geometry.robust import truncated
from panoptic_ros.kernels import inlined, njit
from panoptic_ros.solving.joint_records import Candidates, Claims, SolvedJoints
from panoptic_ros.solving.scene import MIN_DEPTH, Observations, is_outside, seen_at
from panoptic_ros.solving.triangulation import TABLE, Result, SolverRules, Steps, intersect, refine_point

Array = np.ndarray

GOOD_COST = 3.0  # truncated cost per view (2 is expected) up to which the prediction is taken as the start
DENIED = 2.0  # standard deviations; gate of two views about a firm prediction
MANY_VIEWS = 8  # from here on a wrong place cannot be that cheap, and twice the cost is good enough
MISPLACED = 0.15  # of a 2D person's size, deviation of border artefacts: medians .09-.15, rms .15-.23
FITS = 4.0  # squared standard deviations of a 2D joint up to which it is no artefact
GUIDED_STEPS, ROUGH_STEPS, LAST_STEPS = 3, 4, 6  # of Gauss-Newton, at most


class _Joint(NamedTuple):
    """One joint of one person: where it should be, how exactly, and how it moves."""

    person: int
    number: int
    expected: Array
    spread: float
    shift: Array


class _Room(NamedTuple):
    """Arrays to work in.

    x: (3,) m, the joint. picks: (V, 2) its observations. own: (V, 2) those of the own 2D people.
    have: (V,) views that have one. trial: (3,) m.
    """

    x: Array
    picks: Array
    own: Array
    have: Array
    trial: Array


@inlined
def artefact_cost(squared, precision, size):
    """Cost of a 2D joint that a detector reports although the joint lies outside of the image.

    -2 log likelihood relative to that of an observation without error: artefacts lie around the joint with a
    standard deviation of MISPLACED times the size of the 2D person.

    Args:
        squared: distance to the projection, squared. precision: 1 / standard deviation of observations.
        size: of the 2D person; all on the plane at 1 m. inf: there are no artefacts.
    """
    spread = max(MISPLACED * size * precision, 1.0)  # in standard deviations of observations
    return 4.0 * np.log(spread) + squared * (precision / spread) ** 2


@njit(cache=True, error_model="numpy")
def pick_observations(x, joint, claims, seen, rules, picks):
    """Observation of least cost in every view for the point x; returns the sum of their truncated costs.

    picks (V, 2): 2D person and joint of it, -1 where the view has none, or where the point lies outside of
    the image and the view's own 2D joint is rather an artefact.
    """
    member, source, owner = claims
    plane, precision, p, j = seen.plane, seen.precision, joint.person, joint.number
    limit, penalty = rules.truncation * rules.truncation, rules.foreign_penalty
    total = 0.0
    for v in range(len(picks)):
        picks[v, 0] = -1
        best = np.inf
        u, w, depth = seen_at(seen.cams, v, x, joint.shift)
        if depth <= MIN_DEPTH:
            continue
        own = member[p, v]
        if own >= 0:
            s = source[p, v, j]
            if precision[own, s] > 0.0 and (owner[own, s] < 0 or owner[own, s] == p):
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
        least = min(best, limit) - penalty  # what others must stay below
        if least <= 0.0:
            total += truncated(best, limit)
            continue
        for d in range(seen.starts[v], seen.starts[v + 1]):
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
def start_from_prediction(joint, claims, seen, rules, room, result):
    """Refine the predicted place and pick observations there; the cost, infinite if too few views."""
    x, picks = room.x, room.picks
    for i in range(3):
        x[i] = joint.expected[i]
    pick_observations(x, joint, claims, seen, rules, picks)
    if refine_point(x, joint.shift, picks, seen, rules, Steps(GUIDED_STEPS, False), result) < 2:
        return np.inf
    cost = pick_observations(x, joint, claims, seen, rules, picks)
    return cost + _prior_cost(x, joint, rules.truncation**2)


@njit(cache=True, error_model="numpy")
def start_from_pairs(joint, claims, seen, rules, room, best):
    """The intersection of two of the own views that costs less than `best`, into `room.x`; the least cost.

    Pairs are taken from all over the rig, at most `rules.max_pairs` of them.
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
    """Write the own 2D people that have the joint, and their views, into the room; their number."""
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
    """Truncated squared distance to the prediction in units of its spread."""
    expected = joint.expected
    squared = (x[0] - expected[0]) ** 2 + (x[1] - expected[1]) ** 2 + (x[2] - expected[2]) ** 2
    return truncated(squared / (joint.spread * joint.spread), limit)


def solve_joints(found: Candidates, seen: Observations, rules: SolverRules) -> SolvedJoints:
    """Solve all joints of all people; each 2D joint is given to one of them."""
    people, joints = found.guide.spreads.shape
    solved = SolvedJoints.nothing(people, joints, len(seen.starts) - 1)
    claims = Claims(found.member, found.source, np.full(seen.precision.shape, -1, np.int64))
    _solve_and_settle(np.ones((people, joints), bool), found, claims, seen, rules, solved)
    return solved


def solve_without(
    wrong: Array, solved: SolvedJoints, found: Candidates, seen: Observations, rules: SolverRules
) -> None:
    """Solve again, in place, the joints of which 2D joints are wrong (D, J).

    The precision of these 2D joints becomes 0, in place. All other joints keep their 2D joints unless one of
    the new joints fits them better.
    """
    seen.precision[wrong] = 0.0
    claims = Claims(found.member, found.source, np.full(seen.precision.shape, -1, np.int64))
    todo = claim_right(wrong, claims, solved)
    _solve_and_settle(todo, found, claims, seen, rules, solved)


@njit(cache=True, error_model="numpy")
def claim_right(wrong, claims, solved):
    """Mark the joints (P, J) with wrong 2D joints (D, J); give the others their 2D joints, in place."""
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
    """Compile `claim_right`, which only cut people need."""
    member, source = np.full((1, 1), -1, np.int64), np.zeros((1, 1, 1), np.int64)
    claims = Claims(member, source, np.full((1, 1), -1, np.int64))
    claim_right(np.zeros((1, 1), bool), claims, SolvedJoints.nothing(1, 1, 1))


def _solve_and_settle(
    todo: Array,
    found: Candidates,
    claims: Claims,
    seen: Observations,
    rules: SolverRules,
    solved: SolvedJoints,
) -> None:
    """Solve the joints `todo` (P, J) in place, then again those that lose a 2D joint to another person."""
    solve_again(todo, found.guide, claims, seen, rules, solved, False)
    losers = settle(solved, claims, rules.foreign_penalty)
    if losers.any():
        solve_again(losers, found.guide, claims, seen, rules, solved, True)


@njit(cache=True, error_model="numpy")
def solve_again(todo, guides, claims, seen, rules, solved, claiming):
    """Replace, in place, the results of the joints `todo` (P, J).

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
            joint = _Joint(p, j, guides.positions[p, j], guides.spreads[p, j], guides.shifts[p, j])
            pick = solved.picks[p, j]
            room = _Room(x, pick, own, have, trial)
            result = Result(solved.normals[p, j], solved.residuals[p, j], table)
            for i in range(3):
                solved.positions[p, j, i] = np.nan
            if _start(joint, claims, seen, rules, room, result) == np.inf:
                _forget(pick, result)
                continue
            count = refine_point(x, joint.shift, pick, seen, rules, Steps(LAST_STEPS, True), result)
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
    """Choose the starting point and the observations of a joint, into the room; the cost, inf if none.

    Candidates: the prediction (if any) after a few steps, and intersections of pairs of own views, of which
    the best one is refined, too. The cost is truncated over the views, plus the truncated distance to the
    prediction.
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
        refine_point(x, joint.shift, picks, seen, rules, Steps(ROUGH_STEPS, False), result)
        best = pick_observations(x, joint, claims, seen, rules, picks)
    return best


@njit(cache=True, error_model="numpy")
def _forget(picks, result):
    """Write that nothing was found."""
    for v in range(len(picks)):
        picks[v, 0] = picks[v, 1] = -1
        result.residuals[v] = -1.0
    for i in range(3):
        for k in range(3):
            result.normal[i, k] = 0.0


@njit(cache=True, error_model="numpy")
def settle(solved, claims, penalty):
    """Assign every 2D joint to the skeleton that it fits best, in `claims.owner`.

    The paper (5.3) demands that a 2D detection supports a single skeleton.

    Args:
        solved: `SolvedJoints`. claims: `Claims`. penalty: of foreign joints.

    Returns:
        (P, J) which joints lost a 2D joint.
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
