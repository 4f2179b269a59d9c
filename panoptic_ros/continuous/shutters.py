"""Cameras with a global shutter among cameras with a rolling shutter, and the doubt about them."""

from __future__ import annotations

import numpy as np

Array = np.ndarray
LONGEST_LINE_S = 4e-5  # s per row: 1080 rows in 43 ms


def fastest_shutter(lines: Array) -> Array:
    """Return the camera of the shortest line delay as a mask (C,); a common change makes that delay 0.

    A change common to all line delays shifts the joints of a person against each other in time, by their
    heights in the images. Without bones nothing contradicts that shift.
    """
    fastest = np.zeros(len(lines), bool)
    fastest[lines.argmin()] = True
    return fastest


def global_shutters(lines: Array, covariance: Array, still: Array) -> Array:
    """Return the cameras (C,) whose line delay is 0 rather than anything up to LONGEST_LINE_S.

    Both are equally likely before. The decision starts with the clearest camera; each one fixes its delay, so
    the others become more certain.

    Args:
        lines: (C,) s per row.
        covariance: (C, C).
        still: (C,) True for cameras that are known.
    """
    lines, covariance = lines.copy(), covariance.copy()
    found = np.zeros(len(lines), bool)
    while True:
        left = np.flatnonzero(~still & ~found)
        odds = log_odds(lines[left], np.sqrt(np.maximum(np.diag(covariance)[left], 1e-16)))
        if not len(left) or odds.max() <= 0.0:
            return found
        k = left[int(odds.argmax())]
        found[k] = True
        gain = covariance[:, k] / covariance[k, k]
        lines -= gain * lines[k]
        covariance -= np.outer(gain, covariance[k])


def log_odds(lines: Array, deviations: Array) -> Array:
    """Return the logarithms of the odds that delays are 0, from their estimates and standard deviations."""
    scores = np.maximum(lines, 0.0) / deviations
    odds: Array = np.log(LONGEST_LINE_S / (np.sqrt(2.0 * np.pi) * deviations)) - 0.5 * scores**2
    return odds


def line_doubts(lines: Array, covariance: Array, right: Array, found: Array, fastest: Array) -> Array:
    """Return the covariance (U, U) that wrong decisions on global shutters add to all values.

    The delay of a camera with a global shutter is 0 with the probability of that decision, else it is as
    estimated without the decision. The delay of the fastest camera is 0 if one camera has a global shutter;
    else it is anything that leaves the others below LONGEST_LINE_S.

    Args:
        lines: (C,) s per row.
        covariance: (U, U) of all values if every line delay is unknown; those of line delays are the last.
        right: (U,) derivative of the logarithm of the likelihood at the values.
        found, fastest: (C,) cameras with a global shutter, and the fastest one.
    """
    first = len(covariance) - len(lines)
    covariance = covariance.copy()
    doubts, none = np.zeros_like(covariance), 1.0  # probability that no camera has a global shutter
    if fastest.any():
        room = max(LONGEST_LINE_S - float(lines.max()), 0.0)
        none = room / (room + LONGEST_LINE_S)
        direction = _fixed(covariance, first + int(fastest.argmax()))
    for k in (first + np.flatnonzero(found)).tolist():
        others = covariance.copy()
        for m in (first + np.flatnonzero(found)).tolist():
            if m != k:
                _fixed(others, m)
        variance = others[k, k]
        estimate = float(others[k] @ right)
        wrong = 1.0 / (1.0 + np.exp(log_odds(np.array([estimate]), np.array([np.sqrt(variance)]))[0]))
        along = others[:, k] / variance
        doubts += wrong * (estimate**2 + variance) * np.outer(along, along)
        none *= wrong
    if fastest.any():
        doubts += none * room**2 / 3.0 * np.outer(direction, direction)
    return doubts


def _fixed(covariance: Array, k: int) -> Array:
    """Fix value k, in place; return the change (U,) of all values per change of that value."""
    along: Array = covariance[:, k] / covariance[k, k]
    covariance -= np.outer(along, covariance[k])
    return along
