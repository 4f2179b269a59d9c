"""Association: 2D people assigned to skeletons."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from panoptic_ros.consensus.agreement import agreement_with_people
from panoptic_ros.consensus.cameras import Cameras
from panoptic_ros.consensus.config import GroupingConfig
from panoptic_ros.consensus.evidence import Evidence
from panoptic_ros.consensus.gauss_newton import solve_symmetric
from panoptic_ros.kernels import njit
from panoptic_ros.kernels.order import descending

Array = np.ndarray

MIRROR_MARGIN = 1.15  # exchanged sides must agree this much better
MIN_COMMON = 4  # joints that a 2D person shares with a skeleton or with another


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """One instant, ready for the kernels.

    evidence: the 2D people.
    precision: (D, J) 1 / standard deviation on the normalised plane, 0 = missing.
    mirror: (J,) the joint on the other side.
    cams: of the V views.
    """

    evidence: Evidence
    precision: Array
    mirror: Array
    cams: Cameras


@dataclass(slots=True, eq=False)
class Grouping:
    """An association: which 2D person each skeleton has in each view.

    member: (P, V) row of the evidence, -1 = none. mirrored: (P, V) whether its sides are exchanged.
    """

    member: Array
    mirrored: Array

    @classmethod
    def empty(cls, people: int, views: int) -> Grouping:
        """Nothing is associated."""
        return cls(np.full((people, views), -1, np.int64), np.zeros((people, views), bool))

    def joined(self, other: Grouping) -> Grouping:
        """The rows of both."""
        return Grouping(
            np.concatenate([self.member, other.member]), np.concatenate([self.mirrored, other.mirrored])
        )


def assign(
    scene: Scene, positions: Array, shifts: Array, free: Array, config: GroupingConfig, scale: float
) -> tuple[Grouping, Array]:
    """Assign free 2D people to skeletons, greedily by agreement, at most one per view and skeleton.

    Args:
        positions: (P, J, 3) m, measured or predicted; shifts: (P, J, 3) m/s, their velocities.
        free: (D,) bool, which may be assigned. scale: m, of the agreement.

    Returns:
        the grouping, and free (D,) without those that were assigned and without duplicates of them.
    """
    evidence = scene.evidence
    member, mirrored, left, _, _ = assign_greedily(
        positions, shifts, evidence.plane, scene.precision, evidence.view, scene.cams, scene.mirror, scale,
        free, config.person_agreement, config.duplicate_agreement, evidence.views,
    )  # fmt: skip
    return Grouping(member, mirrored), left


@njit(cache=True, error_model="numpy")
def assign_greedily(positions, shifts, plane, precision, view, cams, mirror, scale, free, least, double,
                    views):  # fmt: skip
    """The loops of `assign`.

    Args:
        least, double: agreement of a member, and of a duplicate. views: V.

    Returns:
        member and mirrored (P, V), free (D,), the agreement of each skeleton with each 2D person (P, D), and
        the number of joints (P, D) that both have.
    """
    straight, mirrored, common = agreement_with_people(
        positions, shifts, plane, precision, view, cams, mirror, scale
    )
    people, rows = straight.shape
    flipped, value = np.empty((people, rows), np.bool_), np.zeros((people, rows))
    for d in range(rows):
        enough = max(1, min(MIN_COMMON, joints_of(precision[d])))
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
    for i in descending(rated[:count]):
        p, d = place[i] // rows, place[i] % rows
        if left[d] and member[p, view[d]] < 0:
            member[p, view[d]], exchanged[p, view[d]] = d, flipped[p, d]
            left[d] = False
    for p in range(people):
        for d in range(rows):
            if member[p, view[d]] >= 0 and value[p, d] >= double:
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


@njit(cache=True, error_model="numpy", nogil=True)
def middle_of_cameras(member, rotations, translations):
    """Mean (3,) m of the centres of the cameras that have a 2D person in member (V,); 0 if none has."""
    middle, count = np.zeros(3), 0
    for v in range(len(member)):
        if member[v] >= 0:
            count += 1
            for i in range(3):
                for k in range(3):
                    middle[i] -= rotations[v, k, i] * translations[v, k]
    return middle / max(count, 1)


@njit(cache=True, error_model="numpy")
def triangulate_linear(member, mirrored, plane, precision, rotations, translations,
                       mirror):  # fmt: skip
    """Linear triangulation (J, 3) m of the 2D people member (V,), NaN with fewer than two views.

    It is solved relative to the mean centre of their cameras. Damping then pulls towards that centre,
    wherever the world has its origin.
    """
    joints = len(mirror)
    points = np.full((joints, 3), np.nan)
    row, middle = np.empty(3), middle_of_cameras(member, rotations, translations)
    moved = np.empty((len(member), 3))
    for v in range(len(member)):
        for i in range(3):
            moved[v, i] = translations[v, i]
            for k in range(3):
                moved[v, i] += rotations[v, i, k] * middle[k]
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
                offset = weight * (moved[v, k] - plane[d, s, k] * moved[v, 2])
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
            points[j, 0], points[j, 1], points[j, 2] = a + middle[0], b + middle[1], c + middle[2]
    return points
