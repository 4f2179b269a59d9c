"""Smoothness of the motion and consistency of the reported covariances."""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from panoptic_ros.evaluation.pairing import FramePair

Array = np.ndarray


@dataclass(frozen=True, slots=True)
class Consistency:
    """Normalised estimation error squared (NEES) of all matched joints with a covariance.

    mean_per_dof: mean squared error weighted with the inverse covariance, over 3; 1 = consistent.
    median_per_expected: its median over that of chi2 with 3 degrees of freedom; 1 = consistent.
    cover95: share of joints within their 95 % ellipsoid.
    joints: how many joints count.
    """

    mean_per_dof: float
    median_per_expected: float
    cover95: float
    joints: int


def acceleration_error(pairs: Sequence[FramePair]) -> float:
    """Mean norm, m/s^2, of the second difference of result minus truth.

    Over three consecutive truth frames in which a person is matched to the same id; NaN if none.
    """
    origin = pairs[0].stamp_ns if pairs else 0
    times = np.array([(pair.stamp_ns - origin) * 1e-9 for pair in pairs])
    errors_by_ids = [_errors(pair) for pair in pairs]
    values = [np.empty(0)]
    for i in range(2, len(pairs)):
        steps = np.diff(times[i - 2 : i + 1])
        if not (steps > 0.0).all():
            continue
        before, middle, after = errors_by_ids[i - 2 : i + 1]
        for key in before.keys() & middle.keys() & after.keys():
            first = (middle[key] - before[key]) / steps[0]
            second = (after[key] - middle[key]) / steps[1]
            values.append(np.linalg.norm(2.0 * (second - first) / steps.sum(), axis=-1))
    norms = np.concatenate(values)
    norms = norms[~np.isnan(norms)]
    return float(norms.mean()) if norms.size else float("nan")


def score_consistency(pairs: Sequence[FramePair]) -> Consistency | None:
    """NEES of all matched joints; None if no covariances were reported."""
    values = [np.empty(0)]
    for pair in pairs:
        rows, columns = pair.matches.T
        error = pair.result[columns] - pair.truth[rows]
        covariance = pair.covariances[columns]
        good = ~(np.isnan(error).any(-1) | np.isnan(covariance).any((-1, -2)))
        scaled = np.linalg.solve(covariance[good], error[good][..., None])[..., 0]
        values.append((error[good] * scaled).sum(-1))
    nees = np.concatenate(values)
    if not nees.size:
        return None
    return Consistency(
        mean_per_dof=float(nees.mean() / 3.0),
        median_per_expected=float(np.median(nees) / chi2.ppf(0.5, 3)),
        cover95=float((nees < chi2.ppf(0.95, 3)).mean()),
        joints=int(nees.size),
    )


def _errors(pair: FramePair) -> dict[tuple[int, int], Array]:
    """Result minus truth (J, 3) m of every match, by its ids."""
    return {
        ids: pair.result[column] - pair.truth[row]
        for ids, (row, column) in zip(pair.match_ids, pair.matches)
    }
