"""Curves of a person's joints that follow from a motion function, with covariances.

The curves are splines as all curves of the room, so that all results read them. They are fitted to the motion
function at dense instants. The difference is below a tenth of a millimetre.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.interpolate import make_lsq_spline

from panoptic_ros.continuous.curves import KnotGrid
from panoptic_ros.continuous.elhayek.polynomials import MotionFunction, basis
from panoptic_ros.continuous.elhayek.skeleton import HingeSkeleton
from panoptic_ros.continuous.misfits import local_misfits
from panoptic_ros.continuous.person import PersonCurve
from panoptic_ros.geometry.splines import DEGREE, control_points

Array = np.ndarray
KNOTS = 24  # knots of the spline per length of a segment
SAMPLES = 3  # instants of the motion function per knot
PART = 256  # number of instants whose covariances are computed at once


def person_curve(
    person: PersonCurve, skeleton: HingeSkeleton, motion: MotionFunction, covariances: Array
) -> PersonCurve:
    """Return the person with the joints of a motion function.

    Args:
        covariances: (G, D, L, D, L) of the coefficients of each segment.
    """
    first, last = float(motion.segments[0, 0]), float(motion.segments[-1, 1])
    step = float(motion.segments[0, 1] - motion.segments[0, 0]) / KNOTS
    grid = KnotGrid(first, step, control_points(first, last, step))
    at_knots = first + step * np.arange(grid.number - DEGREE + 1)
    times = np.linspace(first, at_knots[-1], SAMPLES * (grid.number - DEGREE) + 1)
    joints, seen = skeleton.joints(motion.at(times)), skeleton.seen
    knots = first + step * np.arange(-DEGREE, grid.number + 1)
    points = np.full((grid.number, *joints.shape[1:]), np.nan)
    points[:, seen] = make_lsq_spline(times, joints[:, seen], knots, DEGREE).c
    parts = [at_knots[low : low + PART] for low in range(0, len(at_knots), PART)]
    spreads = np.concatenate([joint_covariances(skeleton, motion, covariances, part) for part in parts])
    places = skeleton.joints(motion.at(at_knots))[:, seen]
    misfits = local_misfits(person, at_knots, seen, places, spreads[:, seen])
    spreads[:, seen] += misfits[..., None, None] * np.eye(3)
    return replace(person, grid=grid, points=points, covariances=spreads)


def joint_covariances(
    skeleton: HingeSkeleton, motion: MotionFunction, covariances: Array, times: Array
) -> Array:
    """Return the covariances (T, J, 3, 3) m^2 of the joints at times (T,) s; NaN for those without.

    Segments that overlap share measurements, so their errors correlate in an unknown way. The weighted mean
    of their covariances is an upper bound for any correlation.
    """
    freedoms = motion.at(times)
    spread = np.zeros((*freedoms.shape, freedoms.shape[1]))
    for segment, covariance, weight in zip(motion.segments, covariances, motion.weights(times)):
        inside = weight > 0.0
        values = basis(np.clip(times[inside], *segment), segment, covariance.shape[1])
        own = np.einsum("tl,dlem,tm->tde", values, covariance, values, optimize=True)
        spread[inside] += weight[inside, None, None] * own
    seen = skeleton.seen
    found = np.full((len(times), len(skeleton.site_segments), 3, 3), np.nan)
    _, slopes = skeleton.moved(freedoms, skeleton.site_segments[seen], skeleton.site_offsets[seen])
    found[:, seen] = slopes @ spread[:, None] @ slopes.swapaxes(-1, -2)
    return found
