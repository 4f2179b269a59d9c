"""Assigns 2D poses to tracked people, and finds new people from pairs of 2D poses that agree.

Pairs of free 2D poses whose rays meet are triangulated, and the support of all views is counted. The pair
with the best support becomes a person. This repeats until no pair is left.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.association.config import AssociationConfig
from panoptic_ros.domain import Groups
from panoptic_ros.kernels import njit
from panoptic_ros.solving.agreement import agreement_of_pairs, agreement_with_people
from panoptic_ros.solving.scene import HIDDEN, SEEN, Scene, SceneObservations, ViewVisibility, look_at
from panoptic_ros.solving.triangulation import spread_views, triangulate_linear

Array = np.ndarray

MIRROR_MARGIN = 1.15  # minimum ratio of the agreement with exchanged sides to that without, to exchange them
MIN_COMMON = 4  # minimum number of joints that a 2D pose shares with a skeleton or with another 2D pose
PAIRS_PER_ROUND = 12  # number of pairs that are tried for each new person
MAX_PAIR_VIEWS = 24  # greatest number of views that form pairs; of more, those spread over the rig
REPEAT = 2  # repetitions of the triangulation and assignment of a new person
MISSED_VIEW = 0.1  # additional agreement required per view that should see a new person and does not
BODY = 1.4  # m, distance of the two farthest joints of a person who is mostly visible


def assign(
    scene: Scene, positions: Array, shifts: Array, free: Array, config: AssociationConfig, scale: float
) -> tuple[Groups, Array]:
    """Assign free 2D poses to skeletons, greedily by agreement, at most one per view and skeleton.

    Args:
        positions: (P, J, 3) m, world, measured or predicted.
        shifts: (P, J, 3) m/s, their velocities.
        free: (D,) bool, 2D poses that may be assigned.
        scale: m, standard deviation of the agreement.

    Returns:
        the 2D poses of the skeletons, and free (D,) without those that were assigned.
    """
    # copies: the kernels are compiled for writable arrays, and read-only ones are another type in numba
    member, mirrored, left, _, _ = assign_greedily(
        positions.copy(),
        shifts.copy(),
        scene.observations,
        scene.mirror,
        free,
        scale,
        config.person_agreement,
    )
    return Groups(member, mirrored), left


@njit(cache=True, error_model="numpy")
def assign_greedily(positions, shifts, seen, mirror, free, scale, least):
    """Assign free 2D poses to predicted people, best agreement first; compiled part of `assign`.

    Args:
        least: Agreement from which a 2D pose belongs to a skeleton.

    Returns:
        member, mirrored: (P, V), see `Groups`.
        free: (D,) without the 2D poses that were assigned.
        agreements: (P, D) of each skeleton with each 2D pose.
        common: (P, D) number of joints that both have.
    """
    straight, mirrored, common = agreement_with_people(positions, shifts, seen, mirror, scale)
    view, views = seen.views, len(seen.starts) - 1
    people, rows = straight.shape
    flipped, value = np.empty((people, rows), np.bool_), np.zeros((people, rows))
    for d in range(rows):
        enough = max(1, min(MIN_COMMON, joints_of(seen.precision[d])))
        for p in range(people):
            flipped[p, d] = mirrored[p, d] > MIRROR_MARGIN * straight[p, d]
            if common[p, d] >= enough and free[d]:
                value[p, d] = mirrored[p, d] if flipped[p, d] else straight[p, d]
    member = np.full((people, views), -1, np.int64)
    exchanged = np.zeros((people, views), np.bool_)
    left = free.copy()
    rated, place, count = np.empty(people * rows), np.empty(people * rows, np.int64), 0
    for p in range(people):
        for d in range(rows):
            if value[p, d] >= least:
                rated[count], place[count] = value[p, d], p * rows + d
                count += 1
    for i in np.argsort(-rated[:count], kind="mergesort"):
        p, d = place[i] // rows, place[i] % rows
        if left[d] and member[p, view[d]] < 0:
            member[p, view[d]], exchanged[p, view[d]] = d, flipped[p, d]
            left[d] = False
    for p in range(people):
        for d in range(rows):
            value[p, d] = max(straight[p, d], mirrored[p, d])
    return member, exchanged, left, value, common


@njit(cache=True, error_model="numpy")
def joints_of(precision):
    """Return the number of joints of a 2D pose with the precisions (J,), which are 0 for missing joints."""
    count = 0
    for j in range(len(precision)):
        count += precision[j] > 0.0
    return count


class NewcomerRules(NamedTuple):
    """Conditions for a new person; see `AssociationConfig`."""

    agreement: float  # m, standard deviation of the Gaussian
    person_agreement: float
    min_views: float
    view_share: float
    few_views_share: float
    few_views_agreement: float

    @classmethod
    def of(cls, config: AssociationConfig) -> NewcomerRules:
        """Return the conditions in a configuration."""
        return cls(
            config.agreement,
            config.person_agreement,
            float(config.min_views),
            config.view_share,
            config.few_views_share,
            config.few_views_agreement,
        )


class SearchContext(NamedTuple):
    """Inputs of the search in addition to the 2D poses.

    Args:
        centres: (V, 3) m, world, optical centres of the cameras.
        sight: Fields of view and visibility limits of the views.
        mirror: (J,) joint on the other side.
    """

    centres: Array
    sight: ViewVisibility
    mirror: Array


def find_people(scene: Scene, free: Array, config: AssociationConfig) -> tuple[Groups, Array]:
    """Find new people among the free 2D poses (D,).

    Returns:
        their 2D poses, and a first estimate (P, J, 3) m, world, of their joints.
    """
    if not free.any():
        return Groups.empty(0, len(scene.centres)), np.empty((0, len(scene.mirror), 3))
    member, mirrored, places = search_people(
        free,
        scene.observations,
        SearchContext(scene.centres, scene.sight, scene.mirror),
        NewcomerRules.of(config),
    )
    return Groups(member, mirrored), places


@njit(cache=True, error_model="numpy")
def search_people(free, seen, room, rules):
    """Return the result of `find_people` as arrays: member and mirrored (P, V), positions (P, J, 3) m."""
    precision, views, joints = seen.precision, len(room.centres), len(room.mirror)
    least = rules.person_agreement
    chosen, left = _candidates(free, precision, seen.views, room.centres)
    members = np.empty((len(free) // 2, views), np.int64)  # a person has at least two 2D poses
    mirrors = np.empty(members.shape, np.bool_)
    places = np.empty((len(members), joints, 3))
    found = 0
    if len(chosen) >= 2:
        value, common = agreement_of_pairs(chosen, seen, room.centres, rules.agreement)
        for i in range(len(chosen)):
            for k in range(len(chosen)):
                alike = common[i, k] >= MIN_COMMON and value[i, k] >= least
                value[i, k] = value[i, k] * np.sqrt(common[i, k]) if alike else 0.0
        open_precision = precision.copy()  # 0 for the 2D poses that are assigned
        still_free = SceneObservations(
            seen.plane,
            open_precision,
            seen.views,
            seen.starts,
            seen.cams,
            seen.lenses,
            seen.sizes,
            seen.delays,
        )
        while found < len(members):
            for d in range(len(left)):
                if not left[d]:
                    for j in range(joints):
                        open_precision[d, j] = 0.0
            pairs = best_pairs(value, chosen, left)
            if not len(pairs):
                break
            good, member, flipped, position, rest = _best_supported(
                chosen, pairs, left, still_free, room, rules
            )
            if good:
                for v in range(views):
                    members[found, v], mirrors[found, v] = member[v], flipped[v]
                for j in range(joints):
                    for axis in range(3):
                        places[found, j, axis] = position[j, axis]
                left, found = rest, found + 1
            else:
                for k in range(len(pairs)):
                    value[pairs[k, 0], pairs[k, 1]] = 0.0
    return members[:found].copy(), mirrors[:found].copy(), places[:found].copy()


@njit(cache=True, error_model="numpy")
def _candidates(free, precision, view, centres):
    """Return the rows (L,) of 2D poses that form pairs, and which of all (D,) are free and have joints."""
    used = np.zeros(len(centres), np.bool_)
    for d in range(len(view)):
        used[view[d]] = True
    used = spread_views(centres, used, MAX_PAIR_VIEWS)
    left = free.copy()
    count = 0
    for d in range(len(free)):
        left[d] = free[d] and joints_of(precision[d]) > 0
        count += left[d] and used[view[d]]
    chosen = np.empty(count, np.int64)
    count = 0
    for d in range(len(free)):
        if left[d] and used[view[d]]:
            chosen[count] = d
            count += 1
    return chosen, left


@njit(cache=True, error_model="numpy")
def best_pairs(rank, chosen, left):
    """Return the PAIRS_PER_ROUND pairs of free 2D poses with the highest positive ranks, best first.

    Args:
        rank: (L, L) rank of each pair of `chosen`; only i < k counts.
        chosen: (L,) rows of 2D poses.
        left: (D,) bool, 2D poses that are still free.

    Returns:
        (K, 2) pairs i < k of indices into `chosen`.
    """
    top = np.zeros(PAIRS_PER_ROUND)
    pairs = np.empty((PAIRS_PER_ROUND, 2), np.int64)
    count = 0
    for i in range(len(chosen)):
        if not left[chosen[i]]:
            continue
        for k in range(i + 1, len(chosen)):
            if not left[chosen[k]] or rank[i, k] <= 0.0 or (count == len(top) and rank[i, k] <= top[-1]):
                continue
            count = min(count + 1, len(top))
            at = count - 1
            while at > 0 and top[at - 1] < rank[i, k]:
                top[at], pairs[at, 0], pairs[at, 1] = top[at - 1], pairs[at - 1, 0], pairs[at - 1, 1]
                at -= 1
            top[at], pairs[at, 0], pairs[at, 1] = rank[i, k], i, k
    return pairs[:count]


@njit(cache=True, error_model="numpy")
def _best_supported(chosen, pairs, free, seen, room, rules):
    """Return the best supported of the given pairs, as a person.

    Args:
        chosen: (L,) rows of 2D poses.
        pairs: (K, 2) indices into `chosen`.
        free: (D,) bool, 2D poses that may be assigned.

    Returns:
        whether a pair has enough support; member and mirrored (V,), positions (J, 3) m, world, and free (D,)
        without the 2D poses of that person.
    """
    views, mirror, view = len(room.centres), room.mirror, seen.views
    best_score, good = 0.0, False
    best_member, best_flipped = np.full(views, -1, np.int64), np.zeros(views, np.bool_)
    best_place, best_left = np.empty((len(mirror), 3)), free
    still = np.zeros((1, len(mirror), 3))
    for i in range(len(pairs)):
        member, flipped = np.full(views, -1, np.int64), np.zeros(views, np.bool_)
        for k in range(2):
            member[view[chosen[pairs[i, k]]]] = chosen[pairs[i, k]]
        for _ in range(1 + REPEAT):
            place = triangulate_linear(member, flipped, seen, mirror)
            members, mirrors, left, value, common = assign_greedily(
                place.reshape(1, -1, 3), still, seen, mirror, free, rules.agreement, rules.person_agreement
            )
            member, flipped = members[0], mirrors[0]
        found = look_at(place, seen.cams, room.sight)
        score, agreement, supporters = _support(member, found, value[0], common[0], seen.precision)
        seeing = np.int64(0)  # a literal would be another type in numba
        for v in range(views):
            seeing += found[v] == SEEN
        if not enough_support(supporters, seeing, agreement, place, rules):
            continue
        if score > best_score:
            good, best_score = True, score
            best_member, best_flipped, best_place, best_left = member, flipped, place, left
    return good, best_member, best_flipped, best_place, best_left


@njit(cache=True, error_model="numpy")
def _support(member, found, value, common, precision):
    """Return the score, the mean agreement and the number of the 2D poses that support a new person.

    The score is the sum of the agreements, weighted by the square roots of the numbers of joints. In the mean
    agreement, each 2D pose counts by the share of its joints that are common. Views from which the person is
    hidden give no support.

    Args:
        member: (V,) row of the person's 2D pose in each view, -1 = none.
        found: (V,) visibility of the person, see `look_at`.
        value, common: (D,) agreement and number of common joints of each 2D pose.
        precision: (D, J) of the 2D joints, 0 = missing.
    """
    score, agreement, supporters = 0.0, 0.0, 0
    for v in range(len(member)):
        d = member[v]
        if d >= 0 and found[v] != HIDDEN:
            score += value[d] * np.sqrt(common[d])
            agreement += value[d] * (common[d] / max(joints_of(precision[d]), 1))
            supporters += 1
    return score, agreement / max(supporters, 1), supporters


@njit(cache=True, error_model="numpy")
def enough_support(supporters, seeing, agreement, place, rules):
    """Return whether the number of supporting views is enough for a new person.

    `min_views` and `view_share` of the views that should see the person are enough. Fewer views are enough if
    they agree well. The more views miss the person, the better the others must agree.

    Args:
        supporters: Number of supporting views.
        seeing: Number of views that should see the person.
        agreement: Mean agreement of the supporting views.
        place: (J, 3) m, positions of the joints.
        rules: `NewcomerRules`.
    """
    if supporters >= max(rules.min_views, np.ceil(rules.view_share * seeing)):
        return True
    if supporters < max(2.0, np.ceil(rules.few_views_share * seeing)):
        return False
    wanted = rules.few_views_agreement + MISSED_VIEW * max(seeing - supporters, 0)
    return worth_by_size(agreement, place) >= wanted


@njit(cache=True, error_model="numpy")
def worth_by_size(agreement, place):
    """Return an agreement with distances between rays taken relative to the size of the person (J, 3) m.

    Rays of two people meet by chance most easily near a camera. Such a false person is small, and so are the
    distances between its rays. So the agreement of a person smaller than BODY is reduced.
    """
    square = 0.0
    for i in range(len(place)):
        for j in range(i):
            apart = 0.0
            for axis in range(3):
                apart += (place[i, axis] - place[j, axis]) ** 2
            if apart > square:  # false for NaN
                square = apart
    return agreement ** max(1.0, BODY**2 / max(square, 1e-6))
