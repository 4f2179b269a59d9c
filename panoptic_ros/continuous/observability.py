"""Clocks that the motion of people determines."""

from __future__ import annotations

import numpy as np

from panoptic_ros.solving.clock_gauge import KNOWN, acquainted

Array = np.ndarray


def known_clocks(covariance: Array) -> Array:
    """Return the cameras (C,) whose offsets are known relative to each other; none, if fewer than two.

    Args:
        covariance: (C, C) of the offsets.
    """
    members = acquainted(covariance)
    inside = covariance[np.ix_(members, members)]
    variances = np.diag(inside) - 2.0 * inside.mean(axis=1) + inside.mean()
    known: Array = members & (members.sum() > 1) & (variances.max() <= KNOWN**2)
    return known
