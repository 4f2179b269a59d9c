"""Stretch of a printed board: printers often scale one direction by up to a percent."""

from __future__ import annotations

import numpy as np

from panoptic_ros.calibration.bundle import PLAIN, adjust
from panoptic_ros.calibration.solve import CalibratedRig

STEP = 5e-3  # relative stretch at which the cost is evaluated; the cost is quadratic far beyond


def stretch_of(rig: CalibratedRig) -> tuple[float, float]:
    """Return the relative stretch of the board along x against y, and its standard deviation.

    The stretch is the minimum of the parabola through three adjustments with fixed stretch (profile
    likelihood). All other unknowns are free, the aspect of pixels too; tilted and turned views separate both.

    Returns:
        stretch and deviation; infinite deviation if the views do not determine it.
    """
    costs = []
    for stretch in (-STEP, 0.0, STEP):
        points = rig.seen.points * np.array([1.0 + 0.5 * stretch, 1.0 - 0.5 * stretch, 1.0])
        costs.append(adjust(rig.seen._replace(points=points), rig.state, PLAIN).cost)
    slope = (costs[2] - costs[0]) / (2.0 * STEP)
    curvature = (costs[2] - 2.0 * costs[1] + costs[0]) / STEP**2
    if not curvature > 0.0:
        return 0.0, float("inf")
    return float(-slope / curvature), float(np.sqrt(2.0 / curvature))
