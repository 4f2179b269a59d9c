"""Common reference of clocks that are only known relative to each other."""

from __future__ import annotations

import numpy as np

Array = np.ndarray
KNOWN = 0.012  # s, maximum standard deviation of a known offset
AGREE = 3e-3  # s; clock offsets that differ by less are treated as equal
CHANCE = 2.0  # standard deviations of the difference, by which equal offsets may differ by chance


def acquainted(covariance: Array, limit: float = KNOWN) -> Array:
    """Return the cameras (C,) whose offsets are known relative to each other; all, if fewer than two.

    A camera without motion may have any offset. Its exclusion keeps it from degrading the other offsets.

    Args:
        covariance: (C, C) of the offsets, or of drifts.
        limit: greatest standard deviation of what is known.
    """
    members = np.ones(len(covariance), bool)
    while members.sum() > 1:
        inside = covariance[np.ix_(members, members)]
        shared = inside.mean(axis=1)
        variances = np.diag(inside) - 2.0 * shared + shared.mean()
        if variances.max() <= limit**2:
            return members
        members[np.flatnonzero(members)[variances.argmax()]] = False
    return np.ones(len(covariance), bool)


def common_shift(offsets: Array, deviations: Array) -> float:
    """Return the unobservable shift (s) common to all offsets (C,), to be subtracted.

    If most cameras agree, their common offset is subtracted, so that they keep their timestamps. Otherwise
    the mean is subtracted.
    """
    best = np.zeros(len(offsets), bool)
    for offset, deviation in zip(offsets, deviations):
        near = np.abs(offsets - offset) <= np.maximum(AGREE, CHANCE * np.hypot(deviations, deviation))
        if near.sum() > best.sum():
            best = near
    return float(offsets[best].mean()) if 2 * best.sum() > len(offsets) else float(offsets.mean())
