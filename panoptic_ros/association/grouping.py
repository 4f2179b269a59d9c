"""2D people given to those who are followed, and new people from pairs of 2D people that agree.

Pairs of free 2D people whose rays meet are triangulated, and the support of all views is counted. The best
supported pair becomes a person. This repeats until no pair is left.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.association.config import AssociationConfig
from panoptic_ros.domain import Groups
from panoptic_ros.kernels import njit
from panoptic_ros.solving.agreement import agreement_of_pairs, agreement_with_people
from panoptic_ros.solving.scene import HIDDEN, SEEN, Observations, Scene, Sight, look_at
from panoptic_ros.solving.triangulation import spread_views, triangulate_linear

Array = np.ndarray

MIRROR_MARGIN = 1.15  # exchanged sides must agree this much better
MIN_COMMON = 4  # joints that a 2D person shares with a skeleton or with another
PAIRS_PER_ROUND = 12  # pairs that are tried for each new person
MAX_PAIR_VIEWS = 24  # views that pairs are taken from; of more, those that are spread over the rig
REPEAT = 2  # how often the association of a new person is repeated
MISSED_VIEW = 0.1  # agreement wanted in addition for each view that should see a new person and does not
BODY = 1.4  # m, largest distance of two joints of a person who is mostly seen


def assign(
    scene: Scene, positions: Array, shifts: Array, free: Array, config: AssociationConfig, scale: float
) -> tuple[Groups, Array]:
    """Assign free 2D people to skeletons, greedily by agreement, at most one per view and skeleton.

    Args:
        positions: (P, J, 3) m, measured or predicted; shifts: (P, J, 3) m/s, their velocities.
        free: (D,) bool, which may be assigned. scale: m, of the agreement.

    Returns:
        their 2D people, and free (D,) without those that were assigned.
    """
    # read-only arrays are a type of their own: kernels are compiled for the other alone
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
    """The loops of `assign`; least: agreement of a member.

    Returns:
        member and mirrored (P, V), free (D,), the agreement of each skeleton with each 2D person (P, D), and
        the number of joints (P, D) that both have.
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
    """Number of joints of a 2D person, from the precisions (J,) of which those that are missing are 0."""
    count = 0
    for j in range(len(precision)):
        count += precision[j] > 0.0
    return count


class NewcomerRules(NamedTuple):
    """What makes a new person; see `AssociationConfig`."""

    agreement: float  # m
    person_agreement: float
    min_views: float
    view_share: float
    few_views_share: float
    few_views_agreement: float

    @classmethod
    def of(cls, config: AssociationConfig) -> NewcomerRules:
        """Those of a configuration."""
        return cls(
            config.agreement,
            config.person_agreement,
            float(config.min_views),
            config.view_share,
            config.few_views_share,
            config.few_views_agreement,
        )


class Room(NamedTuple):
    """What the search knows besides 2D people: centres (V, 3) m of the cameras, `Sight`, mirror (J,)."""

    centres: Array
    sight: Sight
    mirror: Array


def find_people(scene: Scene, free: Array, config: AssociationConfig) -> tuple[Groups, Array]:
    """New people among the free 2D people (D,).

    Returns:
        their 2D people, and positions (P, J, 3) m of a first estimate.
    """
    if not free.any():
        return Groups.empty(0, len(scene.centres)), np.empty((0, len(scene.mirror), 3))
    member, mirrored, places = search_people(
        free, scene.observations, Room(scene.centres, scene.sight, scene.mirror), NewcomerRules.of(config)
    )
    return Groups(member, mirrored), places


@njit(cache=True, error_model="numpy")
def search_people(free, seen, room, rules):
    """The loops of `find_people`: member and mirrored (P, V), places (P, J, 3)."""
    precision, views, joints = seen.precision, len(room.centres), len(room.mirror)
    least = rules.person_agreement
    chosen, left = _candidates(free, precision, seen.views, room.centres)
    members = np.empty((len(free) // 2, views), np.int64)  # a person takes two 2D people at least
    mirrors = np.empty(members.shape, np.bool_)
    places = np.empty((len(members), joints, 3))
    found = 0
    if len(chosen) >= 2:
        value, common = agreement_of_pairs(chosen, seen, room.centres, rules.agreement)
        for i in range(len(chosen)):
            for k in range(len(chosen)):
                alike = common[i, k] >= MIN_COMMON and value[i, k] >= least
                value[i, k] = value[i, k] * np.sqrt(common[i, k]) if alike else 0.0
        open_precision = precision.copy()  # 0 for the 2D people that are assigned
        still_free = Observations(
            seen.plane, open_precision, seen.views, seen.starts, seen.cams, seen.lenses, seen.sizes
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
    """Rows (L,) of the 2D people that form pairs, and which of all (D,) are free and have joints."""
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
    """The PAIRS_PER_ROUND highest positive ranks (K, 2) of i < k of chosen (N,) that are left, best first."""
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
    """The best supported pair: whether there is one; member and mirrored (V,), place (J, 3) m, free (D,)."""
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
        seeing = np.int64(0)  # no literal, which would be a type of its own
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
    """Score, mean agreement and number of the 2D people that support a new person.

    The score is the sum of agreements, weighted by the root of the number of joints. Views from which the
    person is hidden give no support.
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
    """Whether this number of supporting views, of those `seeing`, is enough for a new person (J, 3) m.

    Fewer are enough if they agree well. The more views miss the person, the better the others must agree.
    """
    if supporters >= max(rules.min_views, np.ceil(rules.view_share * seeing)):
        return True
    if supporters < max(2.0, np.ceil(rules.few_views_share * seeing)):
        return False
    wanted = rules.few_views_agreement + MISSED_VIEW * max(seeing - supporters, 0)
    return worth_by_size(agreement, place) >= wanted


@njit(cache=True, error_model="numpy")
def worth_by_size(agreement, place):
    """An agreement with distances relative to the size of the person (J, 3) m.

    Rays of two people meet by chance most easily near a camera. A person put there is small, and so are the
    distances between its rays.
    """
    square = 0.0
    for i in range(len(place)):
        for j in range(i):
            apart = 0.0
            for axis in range(3):
                apart += (place[i, axis] - place[j, axis]) ** 2
            if apart > square:  # false if one is unknown
                square = apart
    return agreement ** max(1.0, BODY**2 / max(square, 1e-6))
