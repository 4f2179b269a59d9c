"""2D people of the views that are nearest to where bodies are expected."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from panoptic_ros.domain.subjects import Instant
from panoptic_ros.kinematics.body.sight import distances
from panoptic_ros.kinematics.body.tracker import SubjectTracker

Array = np.ndarray


def assign_people(
    trackers: Sequence[SubjectTracker | None],
    instant: Instant,
    rotations: Array,
    translations: Array,
    gate: float,
) -> list[dict[int, tuple[Array, Array]]]:
    """2D people of the views for each tracker that has started: nearest first, nobody twice, none beyond the
    gate, m."""
    found: list[dict[int, tuple[Array, Array]]] = [{} for _ in trackers]
    expected = [None if tracker is None else tracker.expected_sites() for tracker in trackers]
    for camera, people in sorted(instant.views.items()):
        claims = []
        for k, sites in enumerate(expected):
            if sites is not None and len(people.points):
                columns, places = sites
                far = distances(people.points, columns, places, rotations[camera], translations[camera])
                claims += [(apart, k, p) for p, apart in enumerate(far.tolist()) if apart < gate]
        taken_trackers, taken_people = set(), set()
        for _, k, p in sorted(claims):
            if k not in taken_trackers and p not in taken_people:
                taken_trackers.add(k)
                taken_people.add(p)
                found[k][camera] = (people.points[p], people.scores[p])
    return found
