"""2D poses that are nearest to expected bodies, or at the position where a subject starts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from panoptic_ros.domain.subjects import InstantViews, Subject
from panoptic_ros.kinematics.body.evidence import EvidenceBuilder
from panoptic_ros.kinematics.body.sight import FEWEST, NEAREST, People, distances
from panoptic_ros.kinematics.body.start import middle_of
from panoptic_ros.kinematics.body.tracker import SubjectTracker

Array = np.ndarray

# m, sideways: limit for views that agree, and maximum distance from the stated start
NEAR, FIRST_GATE = 0.35, 0.8
LEAST = 1e-3  # minimum horizontal part of a ray direction, which avoids a division by 0


def nearest_to_start(
    subject: Subject, instant: InstantViews, weighing: EvidenceBuilder, alone: bool = True
) -> People:
    """Return points (K, 2) and scores (K,) by camera of the person at the subject's start position.

    Without a stated position, they are those of views with a single 2D pose. In a view that misses the
    subject, another person behind or in front of the position may appear to stand there. Views that agree in
    3D therefore take precedence.

    Args:
        alone: True if a view that agrees with no other is accepted where no views agree.
    """
    if subject.start is None:
        return {
            camera: (people.points[0], people.scores[0])
            for camera, people in instant.views.items()
            if len(people.points) == 1
        }
    nearest, apart = People(), dict[int, float]()
    for camera, people in instant.views.items():
        far = [_across(weighing, camera, points, subject.start) for points in people.points]
        if far:
            best = int(np.argmin(far))
            nearest[camera], apart[camera] = (people.points[best], people.scores[best]), far[best]
    near = {camera: own for camera, own in nearest.items() if apart[camera] < NEAR}
    middle = middle_of(weighing, near, None)
    if middle is not None and np.linalg.norm((middle - subject.start)[:2]) < NEAR:
        return near
    return {camera: own for camera, own in nearest.items() if alone and apart[camera] < FIRST_GATE}


def _across(weighing: EvidenceBuilder, camera: int, points: Array, place: Array) -> float:
    """Return the distance, m, between a vertical line and the ray to the middle of a 2D pose (K, 2).

    It is infinite if too few joints are visible or the line is behind the camera.

    Args:
        place: (3,) m, a point of the vertical line.
    """
    seen = points[np.isfinite(points).all(-1)]
    if len(seen) < FEWEST:
        return np.inf
    rotation, translation = weighing.rotations[camera], weighing.translations[camera]
    way = rotation.T @ np.append(np.median(seen, axis=0), 1.0)
    to = place + rotation.T @ translation
    if (rotation @ place + translation)[2] < NEAREST:
        return np.inf
    return abs(float(way[0] * to[1] - way[1] * to[0])) / max(float(np.hypot(*way[:2])), LEAST)


def assign_people(
    trackers: Sequence[SubjectTracker | None],
    instant: InstantViews,
    rotations: Array,
    translations: Array,
    gate: float,
) -> list[People]:
    """Return the 2D poses of the views for each tracker that has started.

    The nearest are assigned first, none twice, and none beyond the gate, m.
    """
    found: list[People] = [{} for _ in trackers]
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
