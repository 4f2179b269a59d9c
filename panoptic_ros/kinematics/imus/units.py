"""The unit of a gyroscope's rates, told by how the orientation of the same device turns.

Nothing is solved from rates, but who reads them besides should know, and a driver that errs there may err
elsewhere.
"""

from __future__ import annotations

import math

import numpy as np

from panoptic_ros.geometry.rotations import from_quaternions, vectors_of

Array = np.ndarray
LEAST_RATE = 0.3  # rad/s, root mean square, of somebody who moves
ALIKE = 0.5  # cosine between the same turns, told in two ways
DEGREES = math.degrees(1.0)  # as rad/s, 57.3 times too much
BETWEEN = math.sqrt(DEGREES)  # of being right and of being in degrees


def turned_by(before: Array, after: Array, seconds: Array) -> Array:
    """Angular velocities (N, 3) rad/s in the device's frame, by orientations (N, 4) w x y z before and after
    so many seconds (N,)."""
    begin, end = from_quaternions(before), from_quaternions(after)
    apart = vectors_of(np.ascontiguousarray(begin.swapaxes(1, 2) @ end))
    found: Array = apart / seconds[:, None]
    return found


def rate_sums(own: Array, told: Array) -> Array:
    """Number of samples, squares of rates (N, 3) that orientations tell, of those that are told, and their
    products, (N, 4) to be added up."""
    return np.column_stack([np.ones(len(own)), (own**2).sum(-1), (told**2).sum(-1), (own * told).sum(-1)])


def odd_units(sums: Array) -> Array:
    """Which rates (N,), of which these (N, 4) are the sums, are of another unit, as far as motion tells."""
    count, own, told, both = sums.T
    moves = (count > 0.0) & (own >= count * LEAST_RATE**2) & (told > 0.0)
    alike = both >= ALIKE * np.sqrt(own * told)
    found: Array = moves & alike & ((told > BETWEEN**2 * own) | (told < own / BETWEEN**2))
    return found


def unit_fault(sums: Array) -> str:
    """What is odd about the unit of rates, of which these (4,) are the sums; "" if nothing is, or nobody
    moves."""
    if not odd_units(sums[None])[0]:
        return ""
    _, own, told, _ = sums.tolist()
    ratio = math.sqrt(told / own)
    guess = "deg/s" if ratio > 1.0 else "rad/s turned from deg once too often"
    return (
        f"sends angular velocities {ratio:.3g} times as large as its orientation turns, so perhaps {guess}; "
        "rad/s is asked for; bodies do not rest on them"
    )
