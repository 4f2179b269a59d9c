"""Curves of one person over a whole recording, fitted window by window on common knots."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from panoptic_ros.continuous.bones import (
    LearntLengths,
    PairDistances,
    learn_lengths,
    pair_distances,
)
from panoptic_ros.continuous.curves import CurveFit, KnotGrid, covariances_at
from panoptic_ros.continuous.problem import CurveProblem, TrackRays, grid_over
from panoptic_ros.continuous.rigid_motion import fit_with_lengths
from panoptic_ros.domain.rig_arrays import RigArrays
from panoptic_ros.geometry.splines import DEGREE, spline

Array = np.ndarray
WINDOW_S = 20.0  # s of curve that a window contributes
OVERLAP_S = 1.0  # s by which a window exceeds its part at both ends; rays farther away have no effect
LENGTH_WINDOWS = 6  # number of windows from which the lengths are learnt


@dataclass(frozen=True, slots=True, eq=False)
class PersonCurve:
    """Motion of one person as a function of time.

    Args:
        id: the same number is the same person.
        grid: knots, in s from the reference of the recording.
        points: (K, J, 3) m, control points.
        covariances: (K - DEGREE + 1, J, 3, 3) m^2, at the knots.
        seen: (V,) s, sorted times of the views that show the person.
        rays: rays behind the curves.
        times: (N,) s, corrected times of the rays.
        trusts: (N,) robust weights of the rays, 0..1.
        bones: lengths between joints.
        until: (s) time from which another curve continues the person.
    """

    id: int
    grid: KnotGrid
    points: Array
    covariances: Array
    seen: Array
    rays: TrackRays
    times: Array
    trusts: Array
    bones: LearntLengths
    until: float = np.inf

    def at(self, times: Array, derivative: int = 0) -> Array:
        """Return positions (T, J, 3) m at times (T,) s, or derivatives: m/s, m/s^2.

        They are NaN outside of the curve.
        """
        curve = spline(self.grid.origin, self.grid.step, self.points)
        values: Array = curve(times, derivative)
        return values

    def with_derived(self, derived: Sequence[tuple[int, tuple[int, ...]]]) -> PersonCurve:
        """Return the person with joints that are means of others, see `SkeletonModel.derived`."""
        points, covariances = self.points.copy(), self.covariances.copy()
        for joint, sources in derived:
            own = list(sources)
            points[:, joint] = points[:, own].mean(axis=1)
            covariances[:, joint] = covariances[:, own].sum(axis=1) / len(own) ** 2
        return replace(self, points=points, covariances=covariances)

    def covariances_at(self, times: Array) -> Array:
        """Return the covariances (T, J, 3, 3) m^2 of the positions, interpolated between knots."""
        place = np.clip((times - self.grid.origin) / self.grid.step, 0.0, len(self.covariances) - 1.0)
        k = np.minimum(place.astype(np.int64), len(self.covariances) - 2)
        share = (place - k)[:, None, None, None]
        values: Array = (1.0 - share) * self.covariances[k] + share * self.covariances[k + 1]
        return values


class CurveWindow:
    """Part of a person's curve: knots first..last, and the problem that includes the overlap."""

    def __init__(
        self, rays: TrackRays, times: Array, arrays: RigArrays, whole: KnotGrid, first: int, last: int
    ):
        overlap = round(OVERLAP_S / whole.step)
        self.first, self.last, self._whole = first, last, whole
        self.begin = max(0, first - overlap)
        end = min(whole.number - DEGREE, last + overlap)
        origin = whole.origin + self.begin * whole.step
        grid = KnotGrid(origin, whole.step, end - self.begin + DEGREE)
        inside = (times >= origin) & (times <= origin + (end - self.begin) * whole.step)
        self.inside = inside
        self.problem = CurveProblem(rays.subset(inside), times[inside], arrays, grid)
        self.fit: CurveFit | None = None

    @property
    def own_points(self) -> Array:
        """Return the indices of the control points that the window contributes to the whole curve."""
        whole = self._whole
        first = self.first + (DEGREE // 2 if self.first else 0)
        last = self.last + (DEGREE // 2 if self.last < whole.number - DEGREE else DEGREE)
        return np.arange(first, last)

    def solve(self) -> CurveFit:
        """Return the curves fitted joint by joint; they are computed once."""
        if self.fit is None:
            self.fit = self.problem.solve()
        return self.fit


def window_limits(whole: KnotGrid) -> list[tuple[int, int]]:
    """Return the first and the last knot of each window of a curve."""
    knots = whole.number - DEGREE
    parts = max(1, round(knots * whole.step / WINDOW_S))
    borders = np.linspace(0, knots, parts + 1).round().astype(np.int64)
    return list(zip(borders[:-1].tolist(), borders[1:].tolist()))


def fit_person(
    number: int, rays: TrackRays, times: Array, seen: Array, arrays: RigArrays, pairs: Array
) -> PersonCurve:
    """Fit the curves of one person.

    Args:
        number: id of the person.
        times: (N,) s, corrected times of the rays.
        seen: (V,) s, sorted times of the views.
        pairs: (P, 2) see `rigid_pairs`.
    """
    whole = grid_over(times)
    knots, limits = whole.number - DEGREE, window_limits(whole)
    parts = len(limits)

    def window(k: int) -> CurveWindow:
        return CurveWindow(rays, times, arrays, whole, *limits[k])

    chosen = np.unique(np.linspace(0, parts - 1, LENGTH_WINDOWS).round().astype(np.int64)).tolist()
    kept = {k: window(k) for k in chosen}
    found = [
        pair_distances(one.problem, one.solve(), pairs) for one in kept.values() if len(one.problem.times)
    ]
    bones = learn_lengths(PairDistances(*(np.concatenate(part, axis=1) for part in zip(*found))))
    joints = len(rays.starts) - 1
    points = np.empty((whole.number, joints, 3))
    covariances = np.empty((knots + 1, joints, 3, 3))
    trusts = np.zeros(len(times))
    for k in range(parts):
        one = kept.pop(k, None) or window(k)
        fit = fit_with_lengths(one.problem, one.solve(), pairs, bones)
        own = one.own_points
        points[own] = fit.points[:, own - one.begin].transpose(1, 0, 2)
        at = np.arange(one.first, one.last + 1)
        instants = whole.origin + at * whole.step
        covariances[at] = covariances_at(fit.inverses, one.problem.grid, instants).transpose(1, 0, 2, 3)
        trusts[one.inside] = 1.0 / one.problem.growths
    return PersonCurve(number, whole, points, covariances, seen, rays, times, trusts, bones)
