"""Lines from one clock to another, one behind the other.

A `ClockModel` is a line y = x + offset + drift (x - reference), whatever its two clocks are. Offsets stay
whole nanoseconds, so that times since 1970 lose nothing.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from panoptic_ros.domain import ClockModel

FOREVER = 2**63 - 1


def standing(clock: str, from_ns: int, until_ns: int) -> ClockModel:
    """The line from a clock to itself, observed between two of its times."""
    return ClockModel(clock, until_ns, 0, 0.0, np.zeros((2, 2)), 0.0, from_ns, until_ns)


def inverse(line: ClockModel, clock: str) -> ClockModel:
    """The line from y to x.

    Args:
        clock: name of y.
    """
    slope = 1.0 + line.drift
    return ClockModel(
        clock,
        max(0, line.reference_ns + line.offset_ns),
        -line.offset_ns,
        -line.drift / slope,
        line.covariance,
        -line.residual_ns / slope,
        max(0, line.master_from_device(line.from_ns)[0]),
        max(0, line.master_from_device(line.until_ns)[0]),
        line.wander,
    )


def behind(first: ClockModel, second: ClockModel) -> ClockModel:
    """The line from x to z, of one from x to y and one from y to z.

    Their errors are taken as independent. It is observed where both are.
    """
    at = first.reference_ns + first.offset_ns  # y of the reference, but for the residual
    since = at - second.reference_ns + first.residual_ns
    carry = np.array([[1.0, since * 1e-9], [0.0, 1.0]])
    seen = [
        stamp + at - first.reference_ns + round(first.drift * (stamp - first.reference_ns))
        for stamp in (first.from_ns, first.until_ns)
    ]
    return replace(
        first,
        offset_ns=first.offset_ns + second.offset_ns,
        residual_ns=first.residual_ns + second.residual_ns + second.drift * since,
        drift=(1.0 + first.drift) * (1.0 + second.drift) - 1.0,
        covariance=first.covariance + carry @ second.covariance @ carry.T,
        from_ns=first.from_ns + max(0, second.from_ns - seen[0]),
        until_ns=max(first.from_ns, first.until_ns - max(0, seen[1] - second.until_ns)),
        wander=first.wander + second.wander,
    )


def by_labels(line: ClockModel, shift_ns: int) -> ClockModel:
    """A line from times of a timecode that run on, as one from its labels: times less the shift."""
    return replace(
        line,
        reference_ns=max(0, line.reference_ns - shift_ns),
        offset_ns=line.offset_ns + shift_ns,
        from_ns=max(0, line.from_ns - shift_ns),
        until_ns=max(0, line.until_ns - shift_ns),
    )
