"""Whether errors of joints lie in the ellipsoids that their covariances state, by how many views see them."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from panoptic_ros.evaluation.pairing import FramePair

Array = np.ndarray

ELLIPSOID_95 = 7.815  # squared Mahalanobis distance in space within which 95 % of errors lie
ALL = "all"
SEEN_BY = (("two views and more", 2, 1000), ("one view", 1, 1), ("no view", 0, 0))  # from and up to


def squared_distances(gaps: Array, covariances: Array) -> Array:
    """Squared Mahalanobis distances (...,) of errors (..., 3) m; NaN = no error."""
    squares = np.full(gaps.shape[:-1], np.nan)
    there = np.isfinite(gaps[..., 0])
    own = gaps[there][..., None]
    squares[there] = (own.swapaxes(-1, -2) @ np.linalg.solve(covariances[there], own))[..., 0, 0]
    return squares


@dataclass
class EllipsoidTally:
    """Joints of people, instant after instant, some of them given."""

    asked: int = 0  # joints that are true
    errors: list[Array] = field(default_factory=list)  # (N,) m of the joints that are given
    squares: list[Array] = field(default_factory=list)  # (N,) squared Mahalanobis distances
    views: list[Array] = field(default_factory=list)  # (N,) that measured them

    def take(self, pair: FramePair, people: Collection[int] | None = None) -> None:
        """One more instant; people: true ids who alone count, None = everybody."""
        ids = pair.truth_ids.tolist()
        counted = [row for row, number in enumerate(ids) if people is None or number in people]
        self.asked += int(np.isfinite(pair.truth[counted, :, 0]).sum())
        for t, r in pair.matches.tolist():
            if t not in counted:
                continue
            gaps = pair.result[r] - pair.truth[t]
            there = np.isfinite(gaps[:, 0])
            self.errors.append(np.linalg.norm(gaps[there], axis=-1))
            self.squares.append(squared_distances(gaps[there], pair.covariances[r, there]))
            self.views.append(pair.views[r, there])

    def rows(self) -> dict[str, Mapping[str, Any]]:
        """Of all joints, and of those that so many views see, where there are any.

        given: their share of the true joints. mean_mm, p95_mm; in_ellipsoid: share of them that lie in their
        own 95 % ellipsoid.
        """
        errors, squares, views = (_whole(found) for found in (self.errors, self.squares, self.views))
        masks = {ALL: np.ones(len(errors), bool)}
        masks |= {name: (views >= least) & (views <= most) for name, least, most in SEEN_BY}
        return {
            name: {
                "given": float(own.sum() / max(self.asked, 1)),
                "mean_mm": 1e3 * float(errors[own].mean()),
                "p95_mm": 1e3 * float(np.quantile(errors[own], 0.95)),
                "in_ellipsoid": float((squares[own] < ELLIPSOID_95).mean()),
            }
            for name, own in masks.items()
            if own.any()
        }


def _whole(found: Sequence[Array]) -> Array:
    return np.concatenate(found) if found else np.zeros(0)
