"""Who stands where a subject starts."""
from __future__ import annotations

import math

import numpy as np

from panoptic_ros.domain.subjects import Instant, Subject
from panoptic_ros.kinematics.body.evidence import Weighing

Array = np.ndarray

FIRST_GATE = 0.8  # m, from where a subject is said to start


def nearest_to_start(
    subject: Subject, instant: Instant, weighing: Weighing
) -> dict[int, tuple[Array, Array]]:
    """Points (K, 2) and scores (K,) by camera of who stands where the subject starts; where nothing says so,
    of who is alone in a view."""
    found = {}
    for camera, people in instant.views.items():
        if subject.start is None:
            if len(people.points) == 1:
                found[camera] = (people.points[0], people.scores[0])
            continue
        if not len(people.points):
            continue
        local = weighing.rotations[camera] @ subject.start + weighing.translations[camera]
        if local[2] < 0.1:
            continue
        goal = local[:2] / local[2]
        far = [_middle_distance(points, goal) * local[2] for points in people.points]
        best = int(np.argmin(far))
        if far[best] < FIRST_GATE:
            found[camera] = (people.points[best], people.scores[best])
    return found


def _middle_distance(points: Array, goal: Array) -> float:
    """From the middle of a 2D person's joints (K, 2) to a point (2,); infinite if it has none."""
    seen = points[np.isfinite(points).all(-1)]
    return float(np.linalg.norm(np.median(seen, axis=0) - goal)) if len(seen) else math.inf
