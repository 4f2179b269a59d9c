"""Association: 2D people assigned to skeletons."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.association.config import AssociationConfig
from panoptic_ros.domain import Groups
from panoptic_ros.kernels import njit
from panoptic_ros.kernels.order import descending
from panoptic_ros.solving.agreement import agreement_with_people
from panoptic_ros.solving.scene import Scene

Array = np.ndarray

MIRROR_MARGIN = 1.15  # exchanged sides must agree this much better
MIN_COMMON = 4  # joints that a 2D person shares with a skeleton or with another


class AssignmentRules(NamedTuple):
    """scale (m) of the agreement; least agreement of a member."""

    scale: float
    least: float


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
        positions.copy(), shifts.copy(), scene.observations, scene.mirror, free,
        AssignmentRules(scale, config.person_agreement),
    )  # fmt: skip
    return Groups(member, mirrored), left


@njit(cache=True, error_model="numpy")
def assign_greedily(positions, shifts, seen, mirror, free, rules):
    """The loops of `assign`.

    Returns:
        member and mirrored (P, V), free (D,), the agreement of each skeleton with each 2D person (P, D), and
        the number of joints (P, D) that both have.
    """
    straight, mirrored, common = agreement_with_people(positions, shifts, seen, mirror, rules.scale)
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
            if value[p, d] >= rules.least:
                rated[count], place[count] = value[p, d], p * rows + d
                count += 1
    for i in descending(rated[:count]):
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
