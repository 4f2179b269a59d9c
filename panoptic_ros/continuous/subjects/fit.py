"""Fit of the curves of all degrees of freedom of a person, and the curves of the joints that follow."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.interpolate import make_lsq_spline

from panoptic_ros.continuous.curves import KnotGrid
from panoptic_ros.continuous.elhayek.skeleton import HingeSkeleton
from panoptic_ros.continuous.misfits import local_misfits
from panoptic_ros.continuous.person import CurveWindow, PersonCurve, window_limits
from panoptic_ros.continuous.subjects.curves import FreedomFit, FreedomProblem
from panoptic_ros.continuous.subjects.start import start_points
from panoptic_ros.domain.rig_arrays import RigArrays
from panoptic_ros.geometry.splines import DEGREE, spline

Array = np.ndarray
FINER = (
    2  # knots of the joints' curves per knot of the freedoms' curves; joints then differ by less than 0.01 mm
)
SAMPLES = 3  # instants per knot to which the curves of joints are fitted


def fit_freedoms(
    person: PersonCurve, skeleton: HingeSkeleton, names: Sequence[str], instants: Array, arrays: RigArrays
) -> FreedomFit:
    """Return the curves of the degrees of freedom of a person, on the knots of its joint curves.

    Args:
        instants: (T,) s, see `usable_instants`.
    """
    whole = person.grid
    start = start_points(person, skeleton, names, instants)
    shown = np.isin(person.rays.joints, skeleton.seen)
    rays, times = person.rays.subset(shown), person.times[shown]
    points = np.empty_like(start)
    covariances = np.empty((whole.number - DEGREE + 1, start.shape[1], start.shape[1]))
    for limits in window_limits(whole):
        window = CurveWindow(rays, times, arrays, whole, *limits)
        window.solve()
        first, problem = window.begin, window.problem
        fit = FreedomProblem(problem, skeleton, start[first : first + problem.grid.number]).solve()
        points[window.own_points] = fit.points[window.own_points - first]
        covariances[window.first : window.last + 1] = fit.covariances[
            window.first - first : window.last + 1 - first
        ]
    return FreedomFit(points, covariances)


def with_freedoms(person: PersonCurve, skeleton: HingeSkeleton, fit: FreedomFit) -> tuple[PersonCurve, Array]:
    """Return the person with the joints of a skeleton, and the misfits, see `local_misfits`.

    Joints that the skeleton lacks stay as they are.
    """
    coarse, seen = person.grid, skeleton.seen
    intervals = FINER * (coarse.number - DEGREE)
    grid = KnotGrid(coarse.origin, coarse.step / FINER, intervals + DEGREE)
    end = coarse.origin + coarse.step * (coarse.number - DEGREE)
    times = np.linspace(coarse.origin, end, SAMPLES * intervals + 1)
    freedoms = spline(coarse.origin, coarse.step, fit.points)
    joints = person.at(times)
    joints[:, seen] = skeleton.joints(freedoms(times))[:, seen]
    knots = grid.origin + grid.step * np.arange(-DEGREE, grid.number + 1)
    at_knots = coarse.origin + coarse.step * np.arange(coarse.number - DEGREE + 1)
    places, slopes = skeleton.moved(
        freedoms(at_knots), skeleton.site_segments[seen], skeleton.site_offsets[seen]
    )
    own = slopes @ fit.covariances[:, None] @ slopes.swapaxes(-1, -2)
    misfits = local_misfits(person, at_knots, seen, places, own)
    spreads = person.covariances.copy()
    spreads[:, seen] = own + misfits[..., None, None] * np.eye(3)
    finer = replace(person, grid=grid, points=make_lsq_spline(times, joints, knots, DEGREE).c)
    middles = grid.origin + grid.step * np.arange(intervals + 1)
    return replace(finer, covariances=replace(person, covariances=spreads).covariances_at(middles)), misfits
