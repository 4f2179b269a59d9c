"""A robust first estimate of the joints of associated people, with which voting explains score maps away."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from panoptic_ros.domain import AssociationSet, SkeletonModel
from panoptic_ros.solving.evidence import RigArrays
from panoptic_ros.solving.joint_records import Candidates
from panoptic_ros.solving.joints import solve_joints
from panoptic_ros.solving.scene import Cameras, Observations, even_precision
from panoptic_ros.solving.triangulation import SolverRules

Array = np.ndarray

NOISE = 0.005  # standard deviation of a 2D joint, as a share of the image's diagonal
# no joint is taken from another 2D person
RULES = SolverRules(truncation=4.0, cauchy=2.0, gate=4.0, foreign_penalty=16.0, max_pairs=15)


@dataclass(frozen=True, slots=True, eq=False)
class RoughPeople:
    """Joints of P people of one instant: positions (P, J, 3) m, NaN = unknown; velocities (P, J, 3) m/s."""

    positions: Array
    velocities: Array


def rough_people(item: AssociationSet, arrays: RigArrays, skeleton: SkeletonModel) -> RoughPeople:
    """The joints of the people of a set, each where most of its views support it, at least two."""
    mirror = np.array(skeleton.mirror, np.int64)
    precision = even_precision(item.evidence, arrays, NOISE)
    evidence, rows = item.evidence, item.evidence.cameras
    cams = Cameras(arrays.rotations[rows], arrays.translations[rows], evidence.delays)
    seen = Observations(evidence.plane, precision, evidence.view, evidence.starts, cams)
    found = Candidates.of(item, mirror)
    positions = solve_joints(found, seen, RULES).positions
    for joint, parts in skeleton.derived:
        positions[:, joint] = positions[:, list(parts)].mean(axis=1)
    return RoughPeople(positions, found.guide.shifts)
