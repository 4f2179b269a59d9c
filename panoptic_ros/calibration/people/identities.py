"""Identities: which tracklets of all cameras show the same person."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from panoptic_ros.calibration.people.pairs import TrackletMatch
from panoptic_ros.calibration.people.sightings import JointSightings

Array = np.ndarray


def identities_of(seen: JointSightings, matches: Iterable[TrackletMatch]) -> Array:
    """Return the person (N,) of each tracklet, -1 = in one camera only.

    Matches join tracklets, strongest first. A match is refused if it gives one person two tracklets of one
    camera at one instant.
    """
    group = np.arange(len(seen.cameras))
    for match in sorted(matches, key=lambda one: -one.score):
        a, b = group[match.first], group[match.second]
        if a == b:
            continue
        own, other = np.flatnonzero(group == a), np.flatnonzero(group == b)
        same = seen.cameras[own][:, None] == seen.cameras[other]
        if any((seen.seen[own[i]] & seen.seen[other[j]]).any() for i, j in np.argwhere(same)):
            continue
        group[group == b] = a
    numbers = np.full(len(group), -1)
    people = [n for n in np.unique(group) if len(np.unique(seen.cameras[group == n])) > 1]
    for k, n in enumerate(people):
        numbers[group == n] = k
    return numbers
