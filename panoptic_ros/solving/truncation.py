"""Truncated costs that still tell hopeless places apart."""
from __future__ import annotations

from panoptic_ros.kernels import njit

TIE_BREAK = 1e-6  # share of the limit


@njit(cache=True, error_model="numpy", nogil=True)
def truncated(cost, limit):
    """The truncated value of a cost (>= 0): beyond the limit it grows by at most a share of TIE_BREAK.

    Without that slope all places at which every view is an outlier would cost the same. Which of them is
    taken would then depend on the order of the cameras.
    """
    return cost if cost < limit else limit * (1.0 + TIE_BREAK * (1.0 - limit / cost))
