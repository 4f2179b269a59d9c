"""From a detector's joints to those of the working skeleton."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from panoptic_ros.errors import DataError

Array = np.ndarray


@dataclass(frozen=True, slots=True)
class JointMap:
    """For each of J working joints the detector's joints it is made of.

    Args:
        source_count: number of joints of the detector.
        sources: J tuples: one index = taken as it is; several = their mean in the image (a start
            only: the final position of such a joint is derived in 3D); none = never seen.
    """

    source_count: int
    sources: tuple[tuple[int, ...], ...]

    def apply(self, points: Array, scores: Array) -> tuple[Array, Array]:
        """Points (P, J, 2) and scores (P, J) from the detector's (P, K, 2) and (P, K).

        A mean needs all of its sources and gets the lowest of their scores.

        Raises:
            DataError: if the detector gave another number of joints.
        """
        if points.shape[1] != self.source_count:
            raise DataError(f"{points.shape[1]} joints from a detector of {self.source_count}")
        mapped = np.full((len(points), len(self.sources), 2), np.nan)
        mapped_scores = np.zeros(mapped.shape[:2])
        targets, taken, means = _plan(self.sources)
        mapped[:, targets], mapped_scores[:, targets] = points[:, taken], scores[:, taken]
        for joint, columns in means:
            mapped_scores[:, joint] = scores[:, columns].min(axis=1)
            mapped[:, joint] = points[:, columns].mean(axis=1)
        mapped[mapped_scores <= 0.0] = np.nan
        return mapped, mapped_scores


@lru_cache(maxsize=64)
def _plan(sources: tuple[tuple[int, ...], ...]) -> tuple[Array, Array, list[tuple[int, Array]]]:
    """Joints that are taken as they are, what they are taken from, and the means with their parts."""
    alone = [(joint, own[0]) for joint, own in enumerate(sources) if len(own) == 1]
    means = [(joint, np.array(own)) for joint, own in enumerate(sources) if len(own) > 1]
    return np.array([a for a, _ in alone], int), np.array([b for _, b in alone], int), means
