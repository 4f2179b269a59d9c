"""Who is who in the views: 2D people given to known skeletons, new people from pairs that agree."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from panoptic_ros.consensus.agreement import agreement_of_pairs, agreement_with_people
from panoptic_ros.consensus.config import GroupingConfig
from panoptic_ros.consensus.evidence import Evidence
from panoptic_ros.consensus.gauss_newton import solve_symmetric

Array = np.ndarray

MIRROR_MARGIN = 1.15  # exchanged sides must agree this much better
MIN_COMMON = 4  # joints that a 2D person shares with a skeleton or with another
PAIRS_PER_ROUND = 12  # pairs tried before the best is taken
MAX_PAIR_VIEWS = 24  # of larger rigs, views spread over the rig serve for pairs
REPEAT = 2  # how often a new person's views are collected anew


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """One instant, ready for the kernels.

    precision: (D, J) 1 / standard deviation on the normalised plane, 0 = missing.
    mirror: (J,) the joint on the other side.
    """

    evidence: Evidence
    precision: Array
    mirror: Array
    cams: tuple[Array, Array, Array]


@dataclass(slots=True, eq=False)
class Grouping:
    """Which 2D person each skeleton has in each view.

    member: (P, V) row of the evidence, -1 = none. mirrored: (P, V) its sides are exchanged.
    """

    member: Array
    mirrored: Array

    @classmethod
    def empty(cls, people: int, views: int) -> Grouping:
        """Nobody has anything."""
        return cls(np.full((people, views), -1, np.int64), np.zeros((people, views), bool))

    def joined(self, other: Grouping) -> Grouping:
        """These people and the others."""
        return Grouping(
            np.concatenate([self.member, other.member]), np.concatenate([self.mirrored, other.mirrored])
        )


def assign(
    scene: Scene, positions: Array, shifts: Array, free: Array, config: GroupingConfig, scale: float
) -> tuple[Grouping, Array]:
    """Give free 2D people to skeletons, best agreement first, one per view and skeleton.

    Args:
        positions: (P, J, 3) m, where the skeletons are or should be; shifts: (P, J, 3) m/s.
        free: (D,) bool. scale: m, of the agreement.

    Returns:
        the grouping, and free (D,) without those given away and without duplicates of them.
    """
    evidence = scene.evidence
    member, mirrored, left = give_out(
        positions, shifts, evidence.plane, scene.precision, evidence.view, scene.cams, scene.mirror, scale,
        free, config.person_agreement, config.duplicate_agreement, evidence.views,
    )  # fmt: skip
    return Grouping(member, mirrored), left


@njit(cache=True, error_model="numpy")
def give_out(positions, shifts, plane, precision, view, cams, mirror, scale, free, least, double,
             views):  # type: ignore[no-untyped-def]  # fmt: skip
    """The loops of `assign`: member and mirrored (P, V), and free (D,)."""
    straight, mirrored, common = agreement_with_people(
        positions, shifts, plane, precision, view, cams, mirror, scale
    )
    people, rows = straight.shape
    flipped = mirrored > MIRROR_MARGIN * straight
    value = np.where(flipped, mirrored, straight)
    for d in range(rows):
        enough = max(1, min(MIN_COMMON, (precision[d] > 0.0).sum()))
        for p in range(people):
            if common[p, d] < enough or not free[d]:
                value[p, d] = 0.0
    member = np.full((people, views), -1, np.int64)
    exchanged = np.zeros((people, views), np.bool_)
    left = free.copy()
    flat = value.ravel()
    good = np.flatnonzero(flat >= least)
    for i in good[np.argsort(-flat[good], kind="mergesort")]:
        p, d = i // rows, i % rows
        if left[d] and member[p, view[d]] < 0:
            member[p, view[d]], exchanged[p, view[d]] = d, flipped[p, d]
            left[d] = False
    for p in range(people):
        for d in range(rows):
            if member[p, view[d]] >= 0 and value[p, d] >= double:
                left[d] = False
    return member, exchanged, left


def find_people(scene: Scene, free: Array, config: GroupingConfig) -> tuple[Grouping, Array]:
    """New people among the free 2D people.

    Pairs of 2D people whose rays meet are triangulated, the support of all views is counted, and the
    best supported is taken, until none is left.

    Returns:
        the grouping, and positions (P, J, 3) m of a first estimate.
    """
    evidence = scene.evidence
    found = Grouping.empty(0, evidence.views)
    places = [np.empty((0, len(scene.mirror), 3))]
    free = free & ((scene.precision > 0.0).sum(axis=1) >= 1)
    used = np.zeros(evidence.views, bool)
    used[_spread_views(evidence)] = True
    chosen = np.flatnonzero(free & used[evidence.view])
    if len(chosen) < 2:
        return found, places[0]
    agreement, common = agreement_of_pairs(
        chosen, evidence.plane, scene.precision, evidence.view, scene.cams, evidence.centres,
        config.agreement,
    )  # fmt: skip
    value = np.triu(np.where(common >= MIN_COMMON, agreement, 0.0))
    if value.max() < config.person_agreement:
        return found, places[0]
    rank = value * np.sqrt(common)
    while True:
        rank[~free[chosen]] = 0.0
        rank[:, ~free[chosen]] = 0.0
        rank[value < config.person_agreement] = 0.0
        order = np.argsort(-rank, axis=None, kind="stable")[:PAIRS_PER_ROUND]
        pairs = [np.unravel_index(i, rank.shape) for i in order if rank.flat[i] > 0.0]
        if not pairs:
            break
        best = _best_candidate(scene, chosen, pairs, free, config)
        if best is None:
            for pair in pairs:
                value[pair] = rank[pair] = 0.0
            continue
        grouping, position, free = best
        found = found.joined(grouping)
        places.append(position)
    return found, np.concatenate(places)


def _best_candidate(
    scene: Scene, chosen: Array, pairs: list, free: Array, config: GroupingConfig
) -> tuple[Grouping, Array, Array] | None:
    """The best supported of the pairs: grouping (1, V), positions (1, J, 3), free 2D people left."""
    best, best_score = None, 0.0
    for pair in pairs:
        position = midpoints(scene, chosen[pair[0]], chosen[pair[1]])[None]
        still = np.zeros_like(position)
        grouping, left = assign(scene, position, still, free, config, config.agreement)
        for _ in range(REPEAT):
            position = linear_positions(scene, grouping.member[0], grouping.mirrored[0])[None]
            grouping, left = assign(scene, position, still, free, config, config.agreement)
        supporters = grouping.member[0][grouping.member[0] >= 0]
        few, many = views_needed(scene, position, config)
        score, agreement = _support(scene, position, supporters, config)
        if len(supporters) < (many if agreement < config.few_views_agreement else min(few, many)):
            continue
        if score > best_score:
            best, best_score = (grouping, position, left), score
    return best


def _support(
    scene: Scene, position: Array, supporters: Array, config: GroupingConfig
) -> tuple[float, float]:
    """Agreement of the supporting 2D people: sum, each counted by its number of joints, and mean."""
    if not len(supporters):
        return 0.0, 0.0
    evidence = scene.evidence
    straight, mirrored, common = agreement_with_people(
        position, np.zeros_like(position), evidence.plane[supporters], scene.precision[supporters],
        evidence.view[supporters], scene.cams, scene.mirror, config.agreement,
    )  # fmt: skip
    values = np.maximum(straight, mirrored)[0]
    share = common[0] / np.maximum((scene.precision[supporters] > 0.0).sum(axis=1), 1)
    return float((values * np.sqrt(common[0])).sum()), float((values * share).mean())


def views_needed(scene: Scene, position: Array, config: GroupingConfig) -> tuple[float, float]:
    """Number of views that must support a person at position (1, J, 3).

    The first where few views can see it and they agree well, the second otherwise.
    """
    seeing = float(seeing_views(scene.evidence, position).sum())
    few = max(2.0, np.ceil(config.few_views_share * seeing))
    return few, max(float(config.min_views), np.ceil(config.view_share * seeing))


def seeing_views(evidence: Evidence, positions: Array) -> Array:
    """Which views (P, V) have at least half of the joints (P, J, 3) of a person in the image."""
    local = np.einsum("vik,pjk->pvji", evidence.rotations, positions) + evidence.translations[:, None]
    depth = local[..., 2]
    plane = local[..., :2] / np.where(depth > 0.05, depth, 1.0)[..., None]
    x_low, x_high, y_low, y_high = (evidence.limits[:, i][:, None] for i in range(4))
    inside = (plane[..., 0] > x_low) & (plane[..., 0] < x_high)
    inside &= (plane[..., 1] > y_low) & (plane[..., 1] < y_high) & (depth > 0.05)
    known = np.isfinite(positions[..., 0]).sum(axis=1)
    return inside.sum(axis=-1) >= 0.5 * np.maximum(known, 1)[:, None]


def midpoints(scene: Scene, first: int, second: int) -> Array:
    """Joints (J, 3) m midway between the rays of two 2D people, NaN where not both have them."""
    evidence = scene.evidence
    member = np.full(evidence.views, -1, np.int64)
    member[evidence.view[first]], member[evidence.view[second]] = first, second
    return linear_positions(scene, member, np.zeros(evidence.views, bool))


def linear_positions(scene: Scene, member: Array, mirrored: Array) -> Array:
    """Linear triangulation (J, 3) m of the 2D people member (V,), NaN with fewer than two views."""
    evidence = scene.evidence
    return triangulate_linear(
        member, mirrored, evidence.plane, scene.precision, evidence.rotations, evidence.translations,
        scene.mirror,
    )  # fmt: skip


@njit(cache=True, error_model="numpy")
def triangulate_linear(member, mirrored, plane, precision, rotations, translations,
                       mirror):  # type: ignore[no-untyped-def]  # fmt: skip
    """The loops of `linear_positions`."""
    joints = len(mirror)
    points = np.full((joints, 3), np.nan)
    row = np.empty(3)
    for j in range(joints):
        normal, right = np.zeros((3, 3)), np.zeros(3)
        count = 0
        for v in range(len(member)):
            d = member[v]
            if d < 0:
                continue
            s = mirror[j] if mirrored[v] else j
            weight = precision[d, s]
            if weight <= 0.0:
                continue
            count += 1
            for k in range(2):
                for i in range(3):
                    row[i] = weight * (plane[d, s, k] * rotations[v, 2, i] - rotations[v, k, i])
                offset = weight * (translations[v, k] - plane[d, s, k] * translations[v, 2])
                for i in range(3):
                    right[i] += row[i] * offset
                    for m in range(i + 1):
                        normal[i, m] += row[i] * row[m]
        if count < 2:
            continue
        damping = 1e-9 * max(normal[0, 0] + normal[1, 1] + normal[2, 2], 1e-9)
        good, a, b, c = solve_symmetric(
            normal[0, 0] + damping, normal[1, 0], normal[1, 1] + damping, normal[2, 0], normal[2, 1],
            normal[2, 2] + damping, right[0], right[1], right[2],
        )  # fmt: skip
        if good:
            points[j, 0], points[j, 1], points[j, 2] = a, b, c
    return points


def _spread_views(evidence: Evidence) -> Array:
    """Up to MAX_PAIR_VIEWS views with 2D people, spread over the rig farthest first."""
    seen = np.unique(evidence.view)
    if len(seen) <= MAX_PAIR_VIEWS:
        return seen
    centres = evidence.centres[seen]
    picked = [0]
    distance = np.linalg.norm(centres - centres[0], axis=1)
    while len(picked) < MAX_PAIR_VIEWS:
        picked.append(int(distance.argmax()))
        distance = np.minimum(distance, np.linalg.norm(centres - centres[picked[-1]], axis=1))
    return seen[np.sort(picked)]
