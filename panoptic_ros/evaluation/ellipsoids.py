"""Consistency of joint covariances: share of errors inside the 95 % ellipsoids, by number of views."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from panoptic_ros.evaluation.pairing import FramePair

Array = np.ndarray

ELLIPSOID_95 = 7.815  # 95 % quantile of the squared Mahalanobis distance in 3D (chi2, 3 degrees of freedom)
ALL = "all"
# (name, smallest and largest number of views)
SEEN_BY = (("two views and more", 2, 1000), ("one view", 1, 1), ("no view", 0, 0))


def squared_distances(gaps: Array, covariances: Array) -> Array:
    """Return squared Mahalanobis distances (...,) of errors (..., 3) m; NaN where the error is NaN."""
    squares = np.full(gaps.shape[:-1], np.nan)
    there = np.isfinite(gaps[..., 0])
    own = gaps[there][..., None]
    squares[there] = (own.swapaxes(-1, -2) @ np.linalg.solve(covariances[there], own))[..., 0, 0]
    return squares


@dataclass
class EllipsoidTally:
    """Running collection of joint errors over instants, with covariances and numbers of views."""

    asked: int = 0  # number of true joints
    errors: list[Array] = field(default_factory=list)  # (N,) m; errors of estimated joints
    squares: list[Array] = field(default_factory=list)  # (N,) squared Mahalanobis distances
    views: list[Array] = field(default_factory=list)  # (N,) number of views that measured each joint

    def take(self, pair: FramePair, people: Collection[int] | None = None) -> None:
        """Add one instant.

        Args:
            people: Truth ids of the people who count; None = all.
        """
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
        """Return scores of all joints, and of joints by number of views, where there are any.

        given: number of these joints / number of true joints. mean_mm, p95_mm: Mean and 95th percentile of
        the error. in_ellipsoid: Share of errors inside the joint's own 95 % ellipsoid.
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
