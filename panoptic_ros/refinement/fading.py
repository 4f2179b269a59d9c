"""Changes of places that nobody made are followed gradually, where the surface shows how joints move.

A measured position, or the length of a bone, moves a joint along with all that is known of its past. Of that
a result makes a step from one instant to the next. What joints themselves do since is taken at once.
"""

from __future__ import annotations

import numpy as np

Array = np.ndarray

LEAST = 0.018  # s, over which what later views tell is faded in, however short the lag is
SLOW_BONES = 0.03  # s, the same of what bones tell of errors that last


def not_yet(change: Array, linked: Array, dt: float, span: float) -> Array:
    """What of a change (P, J, 3) m is not followed yet, dt s after the moment before, over a span s.

    Joints without a link (P, J), and those of which nothing was known (NaN), are followed at once.
    """
    left: Array = np.where(np.isnan(change) | ~linked[..., None], 0.0, np.exp(-dt / span) * change)
    return left


def settled(apart: Array, linked: Array, dt: float, span: float) -> Array:
    """By how much what is shown still differs from what is known, in place m and speed m/s (P, J, 6), dt s
    after it differed by `apart` (P, J, 6); joints as in `not_yet`.

    The two meet as a critically damped spring does, which lags by the span: what is shown never steps, nor
    does its speed, whatever views tell. If only places are followed, by an exponential, each measurement is
    an impulse of acceleration.
    """
    rate = 2.0 / span
    place, speed = apart[..., :3], apart[..., 3:]
    pull = speed + rate * place
    later = np.exp(-rate * dt) * np.concatenate([place + dt * pull, speed - rate * dt * pull], axis=-1)
    left: Array = np.where(np.isnan(later) | ~linked[..., None], 0.0, later)
    return left
