"""Skeletons of tracking: as images show them, and those that have an identity."""
from __future__ import annotations

from dataclasses import replace

import numpy as np

from panoptic_ros.domain import PoseSet, TrackedPoseSet

Array = np.ndarray


def as_images_show(item: PoseSet) -> PoseSet:
    """The skeletons with known biases of the detector: predictions are compared with images."""
    if item.corrections is None:
        return item
    return replace(item, positions=item.positions - item.corrections)


def tracked(item: PoseSet, rows: Array, ids: Array) -> TrackedPoseSet:
    """The chosen skeletons with their ids."""
    everybody = np.array_equal(rows, np.arange(len(item.positions)))  # no need to copy then
    names = ("positions", "covariances", "scores", "views", "states", "person_scores")
    arrays = {name: getattr(item, name) if everybody else getattr(item, name)[rows] for name in names}
    shift, sources = item.time_shift, item.sources
    if not everybody:
        shift = None if shift is None else shift.rows(rows)
        sources = None if sources is None else sources.rows(rows)
    return TrackedPoseSet(
        item.index, item.stamp_ns, item.skeleton_hash, **arrays, newest_ns=item.newest_ns, time_shift=shift,
        sources=sources, ids=ids,
    )  # fmt: skip
