"""Whether clocks stay on the lines that were found for them."""

from __future__ import annotations

import numpy as np

from panoptic_ros.offsets.estimate import Fit

Array = np.ndarray
PART = 1.0  # s, length of the parts that are compared with the whole
LEAST = 3e-3  # s; less counts as none
CHANCE = 6.0  # standard deviations up to which a part may differ by chance


def straying(fit: Fit, bias: float, inflation: float) -> Array:
    """How far (C,) s the clock of each camera is from its line in the worst part of the time; 0 if it is not.

    The rays of a camera in one part measure its clock there, given everything else. Differences that chance
    or a bias of the detected joints explains do not count.

    Args:
        bias: m, of 2D joints, see `uncertainty.detector_bias`. inflation: of variances.
    """
    seen, cameras = fit.seen, len(fit.offsets)
    worst = np.zeros(cameras)
    if not len(seen.stamp):
        return worst
    parts = np.floor((seen.stamp - seen.stamp.min()) / PART).astype(np.int64)
    count = int(parts.max()) + 1
    cell, cells = seen.camera * count + parts, cameras * count
    strength = np.bincount(cell, fit.precision * (fit.across**2).sum(axis=1), cells)
    pull = np.bincount(cell, fit.precision * (fit.across * fit.misses).sum(axis=1), cells)
    weight = np.bincount(cell, fit.precision, cells)
    told = strength > 0.0
    shift, variance = np.zeros(cells), np.full(cells, np.inf)
    shift[told] = -pull[told] / strength[told]
    variance[told] = inflation / strength[told] + bias**2 * weight[told] / strength[told]
    far = (np.abs(shift) > LEAST) & (shift**2 > CHANCE**2 * variance)
    np.maximum.at(worst, np.arange(cells) // count, np.where(far, np.abs(shift), 0.0))
    return worst
