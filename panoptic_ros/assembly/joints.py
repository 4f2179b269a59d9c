"""The joints of people while they are completed."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from panoptic_ros.domain import SkeletonModel

Array = np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class Joints:
    """Joints of P people; the arrays change in place where joints are placed anew.

    positions: (P, J, 3) m, NaN = missing. covariances: (P, J, 3, 3) m^2. scores, views: (P, J).
    doubts: (P, J) m^2, additional variance because the joint may be at the wrong node.
    """

    positions: Array
    covariances: Array
    scores: Array
    views: Array
    doubts: Array

    def rows(self, which: Array) -> Joints:
        """Those of some of the people, by a mask (P,) or by numbers."""
        return Joints(
            self.positions[which], self.covariances[which], self.scores[which], self.views[which],
            self.doubts[which],
        )  # fmt: skip

    def derive(self, skeleton: SkeletonModel) -> None:
        """Fill joints that are means of others, with the covariance of the mean."""
        for joint, others in skeleton.derived:
            parts = list(others)
            self.positions[:, joint] = self.positions[:, parts].mean(axis=1)
            self.covariances[:, joint] = self.covariances[:, parts].sum(axis=1) / len(parts) ** 2
            self.doubts[:, joint] = self.doubts[:, parts].sum(axis=1) / len(parts) ** 2
            there = np.isfinite(self.positions[:, joint, 0])
            self.scores[:, joint] = np.where(there, self.scores[:, parts].min(axis=1), 0.0)
            self.views[:, joint] = np.where(there, self.views[:, parts].min(axis=1), 0)
