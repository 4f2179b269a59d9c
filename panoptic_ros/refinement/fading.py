"""Changes of places that nobody made are followed gradually, where the surface shows how joints move.

A measured position, or the length of a bone, moves a joint along with all that is known of its past. Of that
a result makes a step from one instant to the next. What joints themselves do since is taken at once.
"""
from __future__ import annotations

import numpy as np

Array = np.ndarray

LEAST = 0.015  # s, over which what later views tell is faded in, however short the lag is
SLOW_BONES = 0.03  # s, the same of what bones tell of errors that last


def not_yet(change: Array, linked: Array, dt: float, span: float) -> Array:
    """What of a change (P, J, 3) m is not followed yet, dt s after the moment before, over a span s.

    Joints without a link (P, J), and those of which nothing was known (NaN), are followed at once.
    """
    left: Array = np.where(np.isnan(change) | ~linked[..., None], 0.0, np.exp(-dt / span) * change)
    return left
