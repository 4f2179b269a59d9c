"""Truncated costs that still tell hopeless places apart."""
from __future__ import annotations

from panoptic_ros.kernels import njit

HAIR = 1e-6


@njit(cache=True, error_model="numpy", nogil=True)
def truncated(cost, limit):
    """What a cost (>= 0) counts for: at most a hair more than the limit.

    Without that hair all places where every view is an outlier would cost the same, and which of them is
    taken would depend on the order of the cameras.
    """
    return cost if cost < limit else limit * (1.0 + HAIR * (1.0 - limit / cost))
