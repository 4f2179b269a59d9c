"""Phantoms: where rays of two people, or of two false detections, meet by chance.

Two views agree by chance on some joints, and on as few of them in the next instant if nothing moves. For
real people two views agree on nearly all joints. So two views must agree on most joints of a person if a
third view should see the person and does not, and three views never agreed on the person.
"""
from __future__ import annotations

import numpy as np

from panoptic_ros.assembly.candidates import Candidates
from panoptic_ros.domain import Prediction
from panoptic_ros.solving.scene import Scene, seeing_views

Array = np.ndarray

FEW_VIEWS = 2  # that may agree by chance
DOUBTED_SHARE = 0.75  # of the joints that both views show


def agreed_shares(
    scene: Scene, found: Candidates, prediction: Prediction, positions: Array, least: float
) -> Array:
    """On what share (P,) of the joints seen in two or more views these must agree to make a person.

    Args:
        positions: (P, J, 3) m of the people found, NaN = missing. least: for people beyond doubt.
    """
    shares = np.full(len(positions), least)
    rows = np.flatnonzero((found.grouping.member >= 0).sum(axis=1) == FEW_VIEWS)
    if len(rows):
        established = np.append(prediction.established, False)  # the last is for new people, -1
        rows = rows[~established[found.who[rows]]]
        seeing = seeing_views(scene, positions[rows]).sum(axis=1)
        shares[rows[seeing > FEW_VIEWS]] = max(least, DOUBTED_SHARE)
    return shares
