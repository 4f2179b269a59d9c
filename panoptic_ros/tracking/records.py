"""Skeletons of tracking: as images show them, and those that have an identity."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from panoptic_ros.domain import PoseSet, TrackedPoseSet
from panoptic_ros.domain.checks import known_good

Array = np.ndarray
OF_INSTANT = ("index", "stamp_ns", "skeleton_hash", "newest_ns")
OF_PEOPLE = ("positions", "covariances", "scores", "views", "states", "person_scores")


def as_images_show(item: PoseSet) -> PoseSet:
    """The skeletons with known biases of the detector: predictions are compared with images."""
    if item.corrections is None:
        return item
    return replace(item, positions=item.positions - item.corrections)


def tracked(item: PoseSet, rows: Array, ids: Array) -> TrackedPoseSet:
    """The chosen skeletons (K,), each once, with their ids; without votes about sides and corrections."""
    everybody = np.array_equal(rows, np.arange(len(item.positions)))  # no need to copy then
    values = {name: getattr(item, name) for name in OF_INSTANT}
    for name in OF_PEOPLE:
        array = getattr(item, name)
        values[name] = array if everybody else array[rows]
    shift, sources = item.time_shift, item.sources
    if not everybody:
        shift = None if shift is None or not len(rows) else shift.rows(rows)
        sources = None if sources is None else sources.rows(rows)
    values |= {"time_shift": shift, "sources": sources, "side_votes": None, "corrections": None}
    return known_good(TrackedPoseSet, values | {"ids": np.array(ids, np.int64)})
