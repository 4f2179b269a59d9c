"""Curve of a person's joints that follows from a motion function, with covariances.

The curve is a spline as all curves of the room, so that all results read it. It interpolates the motion function at
dense instants; the difference is below a tenth of a millimetre.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.interpolate import make_lsq_spline

from panoptic_ros.continuous.curves import Grid
from panoptic_ros.continuous.elhayek.polynomials import MotionFunction, basis, place
from panoptic_ros.continuous.elhayek.skeleton import Skeleton
from panoptic_ros.continuous.person import PersonCurve
from panoptic_ros.geometry.splines import DEGREE, control_points

Array = np.ndarray
KNOTS = 24  # knots of the spline per length of a segment
SAMPLES = 3  # instants of the motion function per knot
PART = 256  # number of instants whose covariances are computed at once


def person_curve(
    person: PersonCurve, skeleton: Skeleton, motion: MotionFunction, covariances: Array, misfits: Array
) -> PersonCurve:
    """Return the person with the joints of a motion function.

    Args:
        covariances: (G, D L, D L) of the coefficients of each segment.
        misfits: (J,) m^2 per axis, variances of the joints about the skeleton.
    """
    first, last = float(motion.segments[0, 0]), float(motion.segments[-1, 1])
    step = float(motion.segments[0, 1] - motion.segments[0, 0]) / KNOTS
    grid = Grid(first, step, control_points(first, last, step))
    end = first + step * (grid.count - DEGREE)
    times = np.linspace(first, end, SAMPLES * (grid.count - DEGREE) + 1)
    joints = skeleton.joints(motion.at(times))
    seen = skeleton.seen
    knots = first + step * np.arange(-DEGREE, grid.count + 1)
    points = np.full((grid.count, *joints.shape[1:]), np.nan)
    points[:, seen] = make_lsq_spline(times, joints[:, seen], knots, DEGREE).c
    at_knots = first + step * np.arange(grid.count - DEGREE + 1)
    spreads = joint_covariances(skeleton, motion, covariances, at_knots)
    spreads += misfits[:, None, None] * np.eye(3)
    return replace(person, grid=grid, points=points, covariances=spreads)


def joint_covariances(
    skeleton: Skeleton, motion: MotionFunction, covariances: Array, times: Array
) -> Array:
    """Return the covariances (T, J, 3, 3) m^2 of the joints at times (T,) s; NaN for those without.

    Segments that overlap share measurements, so their errors correlate in an unknown way. The weighted mean
    of their covariances is an upper bound for any correlation.
    """
    seen = skeleton.seen
    found = np.full((len(times), len(skeleton.site_segments), 3, 3), np.nan)
    count = motion.coefficients.shape[2]
    for low in range(0, len(times), PART):
        part = times[low : low + PART]
        weights = motion.weights(part)
        spread = np.zeros((len(part), skeleton.freedoms, skeleton.freedoms))
        for segment, covariance, weight in zip(motion.segments, covariances, weights):
            inside = weight > 0.0
            if inside.any():
                values = basis(place(np.clip(part[inside], *segment), *segment), count)
                pairs = (values[:, :, None] * values[:, None, :]).reshape(len(values), -1)
                shape = (skeleton.freedoms, count, skeleton.freedoms, count)
                ordered = covariance.reshape(shape).transpose(1, 3, 0, 2).reshape(count * count, -1)
                own = (pairs @ ordered).reshape(-1, skeleton.freedoms, skeleton.freedoms)
                spread[inside] += weight[inside, None, None] * own
        placed = skeleton.place(motion.at(part))
        sites = skeleton.points(placed, skeleton.site_segments[seen], skeleton.site_offsets[seen])
        slopes = skeleton.slopes(placed, skeleton.site_segments[seen], sites)
        found[low : low + PART, seen] = slopes @ spread[:, None] @ slopes.swapaxes(-1, -2)
    return found
