"""Gradual corrections, so that the output does not jump where the surface shows the motion of joints.

A measured position or a bone length corrects the past of a joint together with its present position. The
output would then jump between two instants, although the joint did not. So corrections of the past are
applied gradually. The motion of the joint since the previous instant is applied at once.
"""

from __future__ import annotations

import numpy as np

Array = np.ndarray

LEAST = 0.018  # s, minimum time over which corrections from later views are applied, for any lag
SLOW_BONES = 0.03  # s, time constant of bone corrections of persistent errors


def not_yet(change: Array, linked: Array, dt: float, span: float) -> Array:
    """Return the part of a correction (P, J, 3) m that is not applied yet: exp(-dt / span) of it.

    Joints without a link are corrected at once, as are joints whose correction is unknown (NaN).

    Args:
        change: (P, J, 3) m, the correction.
        linked: (P, J) whether the displacement of the joint was measured on the surface.
        dt: s since the previous moment.
        span: s, time constant.
    """
    left: Array = np.where(np.isnan(change) | ~linked[..., None], 0.0, np.exp(-dt / span) * change)
    return left


def settled(apart: Array, linked: Array, dt: float, span: float) -> Array:
    """Return the remaining difference (P, J, 6) of the output from the estimate after dt, m and m/s.

    The output approaches the estimate like a critically damped spring, which lags by the span. So neither its
    position nor its velocity jumps, whatever the views measure. An exponential decay of the position alone
    would turn each measurement into an impulse of acceleration.

    Args:
        apart: (P, J, 6) m and m/s, output minus estimate at the previous moment, NaN = unknown.
        linked: (P, J) as in `not_yet`; for other joints the result is 0.
        dt: s since the previous moment.
        span: s, lag of the output.
    """
    rate = 2.0 / span
    place, speed = apart[..., :3], apart[..., 3:]
    pull = speed + rate * place
    later = np.exp(-rate * dt) * np.concatenate([place + dt * pull, speed - rate * dt * pull], axis=-1)
    left: Array = np.where(np.isnan(later) | ~linked[..., None], 0.0, later)
    return left
