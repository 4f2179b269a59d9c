"""Which 2D person of each view a skeleton was made of."""
from __future__ import annotations

from itertools import pairwise

import numpy as np

from panoptic_ros.assembly.candidates import Candidates
from panoptic_ros.domain import DetectionSet, Evidence, ViewSources
from panoptic_ros.solving.joints import SolvedJoints

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


def main_people(starts: Array, member: Array, residuals: Array, picks: Array) -> Array:
    """Row (P, V) of the 2D person of each view that gave most joints to each skeleton, -1 = none.

    Detectors mix people up where they overlap, so that somebody's joints can come from two 2D people of one
    view. A view where association found no 2D person has none, even if single joints of others were used.

    Args:
        starts: (V + 1,) first row of each view. member: (P, V) row that association gave, -1 = none; it
            wins where another gave as many, and where no joint of the view was used.
        residuals: (P, J, V), -1 = unused. picks: (P, J, V, 2) row and joint. See `SolvedJoints`.
    """
    given = np.zeros((len(member), starts[-1]))  # joints, by each 2D person to each skeleton
    p, j, v = np.nonzero(residuals >= 0.0)
    np.add.at(given, (p, picks[p, j, v, 0]), 1.0)
    p, v = np.nonzero(member >= 0)
    given[p, member[p, v]] += 0.5
    main = np.full(member.shape, -1, np.int64)
    for view, (start, end) in enumerate(pairwise(starts)):
        if end > start:
            best = start + given[:, start:end].argmax(axis=1)
            main[:, view] = np.where(member[:, view] >= 0, best, -1)
    return main
