"""Stretch of a printed board: printers often scale one direction by up to a percent."""

from __future__ import annotations

import numpy as np

from panoptic_ros.calibration.bundle import PLAIN, Adjustment, Observations, adjust
from panoptic_ros.calibration.solve import CalibratedRig

Array = np.ndarray
STEP = 5e-3  # relative stretch at which the cost is evaluated; the cost is quadratic far beyond
PARTS = 8  # parts of the recording that the jackknife leaves out in turn


def stretch_of(rig: CalibratedRig) -> tuple[float, float]:
    """Return the relative stretch of the board along x against y, and its standard deviation.

    The stretch is the minimum of the parabola through three adjustments with fixed stretch (profile
    likelihood). All other unknowns are free, the aspect of pixels too; tilted and turned views separate both.

    Returns:
        stretch and deviation; infinite deviation if the views do not determine it.
    """
    return _profile(rig.seen, rig.state)


def jackknife_sd(rig: CalibratedRig) -> float:
    """Return the standard deviation of the stretch from estimates that leave out parts of the recording.

    Random delays of webcams cause errors that neighbouring views share. The curvature of the cost assumes
    independent views, and its deviation is then several times too small.
    """
    targets = np.array_split(np.arange(len(rig.seen.firsts) - 1), PARTS)
    found = [_profile(*_without(rig.seen, rig.state, part))[0] for part in targets]
    return float(np.sqrt((PARTS - 1) / PARTS * np.sum((np.array(found) - np.mean(found)) ** 2)))


def _profile(seen: Observations, state: Adjustment) -> tuple[float, float]:
    costs = []
    for stretch in (-STEP, 0.0, STEP):
        points = seen.points * np.array([1.0 + 0.5 * stretch, 1.0 - 0.5 * stretch, 1.0])
        costs.append(adjust(seen._replace(points=points), state, PLAIN).cost)
    slope = (costs[2] - costs[0]) / (2.0 * STEP)
    curvature = (costs[2] - 2.0 * costs[1] + costs[0]) / STEP**2
    if not curvature > 0.0:
        return 0.0, float("inf")
    return float(-slope / curvature), float(np.sqrt(2.0 / curvature))


def _without(seen: Observations, state: Adjustment, targets: Array) -> tuple[Observations, Adjustment]:
    """Return observations in which targets have no weight, and the state."""
    left_out = np.isin(seen.targets, targets)[seen.views]
    return seen._replace(variances=np.where(left_out, np.inf, seen.variances)), state
