"""Which 2D person of each view a skeleton was made of."""
from __future__ import annotations

import numpy as np

from panoptic_ros.assembly.candidates import Candidates
from panoptic_ros.domain import DetectionSet, Evidence, ViewSources
from panoptic_ros.kernels import njit
from panoptic_ros.solving.joint_records import SolvedJoints

Array = np.ndarray


def view_sources(
    detections: DetectionSet, evidence: Evidence, found: Candidates, solved: SolvedJoints, kept: Array
) -> ViewSources:
    """The record for those of the people solved that were kept (P,)."""
    views = [detections.views[slot] for slot in evidence.slots]
    rows = main_people(
        evidence.starts, found.grouping.member[kept], solved.residuals[kept], solved.picks[kept]
    )
    known = np.concatenate([evidence.rows, [-1]])  # -1 stays -1
    return ViewSources(
        tuple(view.camera for view in views), np.array([view.frame_number for view in views]), known[rows]
    )


@njit(cache=True, error_model="numpy")
def main_people(starts, member, residuals, picks):
    """Row (P, V) of the 2D person of each view that gave most joints to each skeleton, -1 = none.

    Detectors mix people up where they overlap, so that somebody's joints can come from two 2D people of one
    view. A view where association found no 2D person has none, even if single joints of others were used.

    Args:
        starts: (V + 1,) first row of each view. member: (P, V) row that association gave, -1 = none; it
            wins where another gave as many, and where no joint of the view was used.
        residuals: (P, J, V), -1 = unused. picks: (P, J, V, 2) row and joint. See `SolvedJoints`.
    """
    people, joints, views = residuals.shape
    given = np.zeros(starts[-1])  # joints, by each 2D person
    main = np.full((people, views), -1, np.int64)
    for p in range(people):
        for d in range(len(given)):
            given[d] = 0.0
        for j in range(joints):
            for v in range(views):
                if residuals[p, j, v] >= 0.0:
                    given[picks[p, j, v, 0]] += 1.0
        for v in range(views):
            best = member[p, v]
            for d in range(starts[v], starts[v + 1] if best >= 0 else starts[v]):
                if given[d] > given[best]:
                    best = d
            main[p, v] = best
    return main
