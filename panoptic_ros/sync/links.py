"""The same people in two frames of one camera."""

from __future__ import annotations

import numpy as np
from scipy.optimize import linear_sum_assignment

from panoptic_ros.domain import ViewDetections

Array = np.ndarray
NEAR = 0.05  # of a person's size: the scale on which joints of one person agree
LEAST_AGREEMENT = 0.2


def link_people(first: ViewDetections, second: ViewDetections) -> list[tuple[int, int]]:
    """Pairs of people, by the joints that lie near each other: sum of exp(-d^2 / 2 (0.05 size)^2).

    The sum counts per joint of the person with fewer joints; pairs below 0.2 are none. Hungarian assignment.
    """
    if not (len(first.points) and len(second.points)):
        return []
    seen_first, seen_second = first.scores > 0.0, second.scores > 0.0
    size = np.maximum(person_sizes(first)[:, None], person_sizes(second)[None])  # (P, Q)
    both = seen_first[:, None] & seen_second[None]
    squared = np.square(first.points[:, None] - second.points[None]).sum(-1)
    near = np.where(both, np.exp(-0.5 * squared / np.square(NEAR * size)[..., None]), 0.0).sum(-1)
    fewer = np.minimum(seen_first.sum(1)[:, None], seen_second.sum(1)[None])
    agreement = near / np.maximum(fewer, 1)
    rows, columns = linear_sum_assignment(-agreement)
    return [(int(i), int(j)) for i, j in zip(rows, columns) if agreement[i, j] >= LEAST_AGREEMENT]


def person_sizes(view: ViewDetections) -> Array:
    """The larger side of each person's box (P,), px; at least 1."""
    points = np.where(view.scores[..., None] > 0.0, view.points, np.nan)
    sizes = np.ones(len(points))
    for k, person in enumerate(points):
        if np.isfinite(person).any():
            sizes[k] = max(1.0, float(np.max(np.nanmax(person, axis=0) - np.nanmin(person, axis=0))))
    return sizes
