"""Acceleration error of the motion, and consistency of the reported covariances."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from panoptic_ros.evaluation.pairing import FramePair

Array = np.ndarray


VIEWS = ("predicted, filled", "1 or 2 views", "3 views", "4 views", "5 views and more")
FIRST_VIEWS = (0, 1, 3, 4, 5)  # smallest number of views of each kind
# 50 % and 95 % quantiles of chi2 with 3 degrees of freedom
MEDIAN_OF_CHI2, COVER_OF_CHI2 = 2.3659738843753377, 7.814727903251179


@dataclass(frozen=True, slots=True)
class ViewCountConsistency:
    """NEES, as in `Consistency`, of the joints measured by a certain number of views."""

    kind: str
    mean_per_dof: float
    cover95: float
    joints: int


@dataclass(frozen=True, slots=True)
class Consistency:
    """Normalised estimation error squared (NEES) of all matched joints with a covariance.

    Args:
        mean_per_dof: Mean NEES divided by its 3 degrees of freedom; 1 = consistent.
        median_per_expected: Median NEES divided by the median of chi2 with 3 degrees of freedom; 1 =
            consistent.
        cover95: Share of joints within their 95 % ellipsoid.
        joints: Number of joints that count.
        by_views: NEES by the number of views that measured a joint, as far as the result reports it.
    """

    mean_per_dof: float
    median_per_expected: float
    cover95: float
    joints: int
    by_views: tuple[ViewCountConsistency, ...]


def acceleration_error(pairs: Sequence[FramePair]) -> float:
    """Return the mean norm (m/s^2) of the second difference of result minus truth; NaN if there is none.

    It counts three consecutive truth frames in which a person is matched to the same id.
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
    """Return the NEES of all matched joints; None if no covariances were reported."""
    values, numbers = [np.empty(0)], [np.empty(0, np.int64)]
    for pair in pairs:
        rows, columns = pair.matches.T
        error = pair.result[columns] - pair.truth[rows]
        covariance = pair.covariances[columns]
        good = ~(np.isnan(error).any(-1) | np.isnan(covariance).any((-1, -2)))
        scaled = np.linalg.solve(covariance[good], error[good][..., None])[..., 0]
        values.append((error[good] * scaled).sum(-1))
        numbers.append(pair.views[columns][good])
    nees, views = np.concatenate(values), np.concatenate(numbers)
    if not nees.size:
        return None
    return Consistency(
        mean_per_dof=float(nees.mean() / 3.0),
        median_per_expected=float(np.median(nees) / MEDIAN_OF_CHI2),
        cover95=_cover(nees),
        joints=int(nees.size),
        by_views=tuple(_by_views(nees, views)),
    )


def _by_views(nees: Array, views: Array) -> Iterator[ViewCountConsistency]:
    """Yield the NEES of joints (N,) by kind of number of views, for kinds with any joints."""
    kinds = np.searchsorted(FIRST_VIEWS, views, side="right") - 1  # -1 = not reported
    for kind, name in enumerate(VIEWS):
        own = nees[kinds == kind]
        if own.size:
            yield ViewCountConsistency(name, float(own.mean() / 3.0), _cover(own), int(own.size))


def _cover(nees: Array) -> float:
    """Return the share of joints within the 95 % ellipsoid."""
    return float((nees < COVER_OF_CHI2).mean())


def _errors(pair: FramePair) -> dict[tuple[int, int], Array]:
    """Return result minus truth (J, 3) m of every match, by its pair of ids."""
    return {
        ids: pair.result[column] - pair.truth[row] for ids, (row, column) in zip(pair.match_ids, pair.matches)
    }
