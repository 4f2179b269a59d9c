"""Who is who in the views: 2D people given to known skeletons, new people from pairs that agree."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from panoptic_ros.assembly.agreement import agreement_of_pairs, agreement_with_people
from panoptic_ros.assembly.config import AssemblyConfig
from panoptic_ros.assembly.evidence import Evidence

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
    scene: Scene, positions: Array, shifts: Array, free: Array, config: AssemblyConfig, scale: float
) -> tuple[Grouping, Array]:
    """Give free 2D people to skeletons, best agreement first, one per view and skeleton.

    Args:
        positions: (P, J, 3) m, where the skeletons are or should be; shifts: (P, J, 3) m/s.
        free: (D,) bool. scale: m, of the agreement.

    Returns:
        the grouping, and free (D,) without those given away and without duplicates of them.
    """
    evidence = scene.evidence
    straight, mirrored, common = agreement_with_people(
        positions, shifts, evidence.plane, scene.precision, evidence.view, scene.cams, scene.mirror,
        scale,
    )  # fmt: skip
    flipped = mirrored > MIRROR_MARGIN * straight
    value = np.where(flipped, mirrored, straight)
    enough = np.minimum(MIN_COMMON, (scene.precision > 0.0).sum(axis=1))
    value[(common < enough) | (common == 0) | ~free] = 0.0
    grouping = Grouping.empty(len(positions), evidence.views)
    left = free.copy()
    who, which = np.nonzero(value >= config.person_agreement)
    for i in np.argsort(-value[who, which], kind="stable"):
        p, d = who[i], which[i]
        v = evidence.view[d]
        if left[d] and grouping.member[p, v] < 0:
            grouping.member[p, v], grouping.mirrored[p, v] = d, flipped[p, d]
            left[d] = False
    taken = grouping.member[:, evidence.view] >= 0  # (P, D)
    return grouping, left & ~(taken & (value >= config.duplicate_agreement)).any(axis=0)


def find_people(scene: Scene, free: Array, config: AssemblyConfig) -> tuple[Grouping, Array]:
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
    chosen = np.flatnonzero(free & np.isin(evidence.view, _spread_views(evidence)))
    agreement, common = agreement_of_pairs(
        chosen, evidence.plane, scene.precision, evidence.view, scene.cams, evidence.centres,
        config.agreement,
    )  # fmt: skip
    value = np.triu(np.where(common >= MIN_COMMON, agreement, 0.0))
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
    scene: Scene, chosen: Array, pairs: list, free: Array, config: AssemblyConfig
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
    scene: Scene, position: Array, supporters: Array, config: AssemblyConfig
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


def views_needed(scene: Scene, position: Array, config: AssemblyConfig) -> tuple[float, float]:
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
    views = np.flatnonzero(member >= 0)
    joints = np.where(mirrored[views][:, None], scene.mirror, np.arange(len(scene.mirror)))
    rows = member[views][:, None]
    plane, weight = evidence.plane[rows, joints], scene.precision[rows, joints]  # (v, J, 2), (v, J)
    rotations, translations = evidence.rotations[views], evidence.translations[views]
    a = weight[..., None, None] * (
        plane[..., None] * rotations[:, None, 2:3, :] - rotations[:, None, :2, :]
    )  # (v, J, 2, 3)
    b = weight[..., None] * (translations[:, None, :2] - plane * translations[:, None, 2:])
    normal = np.einsum("vjki,vjkl->jil", a, a)
    scale = np.trace(normal, axis1=1, axis2=2)[:, None, None]
    normal = normal + 1e-9 * np.maximum(scale, 1e-9) * np.eye(3)
    points = np.linalg.solve(normal, np.einsum("vjki,vjk->ji", a, b)[..., None])[..., 0]
    return np.where(((weight > 0.0).sum(axis=0) >= 2)[:, None], points, np.nan)


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
