"""By how much the motion of limbs that is followed on their surface falls short, learnt from views.

The window of an image round a point on a limb shows what is behind the limb, too, and flow follows a mixture
of both (Black and Anandan 1996 call it the generalised aperture problem). So limbs seem to move against the
torso by a tenth too little, for as long as they move, which no covariance of single displacements tells.
Views measure the same motion, with errors that are not those of flow: the slope of a regression of what they
say of the last instants on what the surface says is by what displacements are multiplied. It belongs to
images and detector, and is learnt of all people together, for each pair of joints (both elbows, both knees).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from panoptic_ros.domain import PartMotions, SkeletonModel
from panoptic_ros.domain.parts import rigid_parts
from panoptic_ros.geometry.robust import growth
from panoptic_ros.geometry.rotations import rotation_of
from panoptic_ros.refinement.links import Links
from panoptic_ros.refinement.records import People

Array = np.ndarray

SPAN = 0.3  # s, over which motions are compared
MEMORY = 10.0  # s, for which comparisons count
PRIOR = 0.05**2 * SPAN  # m^2 s, weight of a gain of 1
SOFT = 0.05  # m, of views from the surface, from which on a comparison counts less
MOST = 1.5  # gain


class Limbs(NamedTuple):
    """The number of the torso among the parts, -1 = none, and the outer joints of limbs, by their kinds."""

    torso: int
    kinds: tuple[tuple[int, ...], ...]


def limbs_of(skeleton: SkeletonModel) -> Limbs:
    """Of a skeleton."""
    parts = rigid_parts(skeleton)
    torso = next((number for number, part in enumerate(parts) if part.name == "torso"), -1)
    first_of = {right: left for left, right in skeleton.left_right}
    kinds: dict[int, list[int]] = {}
    for part in parts:
        if part.is_limb:
            outer = part.joints[1]
            kinds.setdefault(first_of.get(outer, outer), []).append(outer)
    return Limbs(torso, tuple(tuple(joints) for joints in kinds.values()))


def nothing_compared(limbs: Limbs) -> Array:
    """(K, 2) sums m^2 s of K kinds, of products of views and surface, and of squares of the surface."""
    return np.zeros((len(limbs.kinds), 2))


def with_torso(motions: PartMotions, torso: int, ids: Sequence[int], places: Array) -> Array:
    """How places (P, J, 3) m of people with these ids would move with their torsos, NaN = not known."""
    moved = np.full(places.shape, np.nan)
    row_of, rotation = {number: row for row, number in enumerate(ids)}, np.empty((3, 3))
    for k in np.flatnonzero(motions.parts == torso).tolist():
        row = row_of.get(int(motions.people[k]))
        if row is not None:
            rotation_of(motions.rotations[k], rotation)
            arms = places[row] - motions.centres[k]
            moved[row] = arms @ rotation.T - arms + motions.translations[k]
    return moved


def learn_shortfall(sums: Array, people: People, kinds: Sequence[Sequence[int]], dt: float) -> None:
    """Take the motions of the last instants, the newest of dt s, into the sums (K, 2), in place."""
    sums *= np.exp(-dt / MEMORY)
    for k, joints in enumerate(kinds):
        surface, views = people.followed[:, joints], people.seen[:, joints]
        weights = dt / growth(np.square(views - surface).sum(axis=-1), SOFT)
        sums[k, 0] += (weights * (surface * views).sum(axis=-1)).sum()
        sums[k, 1] += (weights * np.square(surface).sum(axis=-1)).sum()


def add_motions(people: People, surface: Array, views: Array, dt: float) -> None:
    """Add motions (P, J, 3) m against the torso to those of the last instants, in place; NaN = begun anew."""
    left = np.exp(-dt / SPAN)
    for kept, new in ((people.followed, surface), (people.seen, views)):
        kept[:] = left * (kept + new)
    known = np.isfinite(people.followed[..., 0] + people.seen[..., 0])
    people.followed[~known] = people.seen[~known] = 0.0


def gains_of(sums: Array) -> Array:
    """(K,) by which motions of limbs against the torso are multiplied, at least 1."""
    gains: Array = np.clip((sums[:, 0] + PRIOR) / (sums[:, 1] + PRIOR), 1.0, MOST)
    return gains


def in_full(links: Links, carried: Array, kinds: Sequence[Sequence[int]], gains: Array) -> Links:
    """Links of limbs with gains (K,) on how they move against what the torso carries along (P, J, 3) m."""
    displacements = links.displacements.copy()
    for joints, gain in zip(kinds, gains.tolist()):
        more = (gain - 1.0) * (displacements[:, joints] - carried[:, joints])
        displacements[:, joints] += np.nan_to_num(more)
    return links._replace(displacements=displacements)
