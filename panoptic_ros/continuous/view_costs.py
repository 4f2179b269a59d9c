"""Distances of the 2D people of a view from people, and which of them a view cannot tell apart."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from panoptic_ros.continuous.motion import JointFilters, ViewRays, distances
from panoptic_ros.solving.frames import CameraFrame

Array = np.ndarray
SIGMA = 4e-3  # standard deviation of a 2D joint on the normalised plane, for association only
MOST_DISTANCE = 6.0  # standard deviations, upper limit of the distance of a joint in means
WIDEST = 0.15  # m, greatest standard deviation of an innovation, for association only
MIRROR_MARGIN = 0.5  # standard deviations by which an exchange of left and right has to fit better
# standard deviations by which the exchange of two people has to fit worse. On 8 rendered captures, 1 to 2
# and 3 give more exchanges of people
SWAP_MARGIN = 2.5


def view_costs(
    filters: JointFilters, view: ViewRays, frame: CameraFrame, people: list[int], mirror: Array
) -> tuple[Array, Array]:
    """Return the distances (D,) of 2D people from a person: as they are, and with left and right exchanged.

    An exchange has to fit better by MIRROR_MARGIN.

    Args:
        people: D rows of the frame.
    """
    planes, known = frame.plane[people], frame.scores[people] > 0.0
    straight = distances(filters, view, planes, known, SIGMA, WIDEST, MOST_DISTANCE)
    planes, known = (np.ascontiguousarray(values[:, mirror]) for values in (planes, known))
    mirrored = distances(filters, view, planes, known, SIGMA, WIDEST, MOST_DISTANCE)
    return straight, mirrored + MIRROR_MARGIN


def ambiguous(costs: Array, pairs: Sequence[tuple[int, int]]) -> set[int]:
    """Return the people (rows) who could exchange their 2D people with others nearly without a loss.

    People in contact look alike to one camera. A wrong 2D person would bend their tracks towards each other.

    Args:
        costs: (T, D) distances of 2D people from people.
        pairs: assigned people and 2D people.
    """
    costs = np.minimum(costs, MOST_DISTANCE)
    own = dict(pairs)
    found = set()
    for row, column in pairs:
        losses = costs[:, column] - costs[row, column]
        for other, mine in own.items():
            losses[other] += costs[row, mine] - costs[other, mine]
        losses[row] = np.inf
        if losses.min() < SWAP_MARGIN:
            found.add(row)
    return found
