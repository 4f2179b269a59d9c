"""Motion functions: polynomials in overlapping segments of time, blended to one curve (paper, 4.2 and 4.4.1).

A polynomial is a sum of Legendre polynomials of the place u in its segment, -1..1. They are orthogonal, so
the coefficients for uneven instants stay well conditioned.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial.legendre import leggauss, legvander

Array = np.ndarray
FRAMES = 2.0  # length of a segment, in frames of the slowest camera (paper, 5)
OVERLAP = 0.6  # share of a segment that it has in common with the previous one (paper, 5)
MARGIN = 0.02  # share of a segment by which the segments exceed the views, because weights end at 0


@dataclass(frozen=True, eq=False)
class MotionFunction:
    """Blended polynomials of D degrees of freedom.

    Args:
        segments: (G, 2) s, first and last instant of each segment, both increasing.
        coefficients: (G, D, L) Legendre coefficients.
    """

    segments: Array
    coefficients: Array

    def at(self, times: Array) -> Array:
        """Return the degrees of freedom (T, D) at times (T,) s, equation 12 of the paper.

        A time outside of all segments counts as the nearest time inside.
        """
        values = np.zeros((len(times), self.coefficients.shape[1]))
        for segment, own, weight in zip(self.segments, self.coefficients, self.weights(times)):
            inside = weight > 0.0
            places = basis(np.clip(times[inside], *segment), segment, own.shape[1])
            values[inside] += weight[inside, None] * (places @ own.T)
        return values

    def weights(self, times: Array) -> Array:
        """Return the weights (G, T) of the segments at times (T,) s; their sum is 1."""
        first, last = self.segments.T
        edge = 1e-3 * (last[0] - first[0])  # all weights are 0 at the outer ends
        inside = np.clip(times, first[0] + edge, last[-1] - edge)
        raw = wendland(np.abs(_place(inside, first[:, None], last[:, None])))
        shares: Array = raw / raw.sum(axis=0)
        return shares


def wendland(x: Array) -> Array:
    """Return Wendland's function phi_3,1 of x >= 0: (1 - x)^4 (4 x + 1), 0 from x = 1 on.

    Its second derivative is continuous.
    """
    values: Array = np.maximum(1.0 - x, 0.0) ** 4 * (4.0 * x + 1.0)
    return values


def segments_over(first: float, last: float, length: float) -> Array:
    """Return overlapping segments (G, 2) s of one length that cover the time from `first` to `last` s.

    The overlap is `OVERLAP`, or slightly more, so that the last segment ends with the views.
    """
    first, last = first - MARGIN * length, last + MARGIN * length
    room = max(last - first - length, 0.0)
    count = int(np.ceil(room / (length * (1.0 - OVERLAP)) - 1e-9)) + 1
    starts = first + np.linspace(0.0, room, count)
    return np.stack([starts, starts + length], axis=1)


def basis(times: Array, segment: Array, count: int) -> Array:
    """Return the values (T, count) of the first Legendre polynomials of a segment (2,) s at times (T,) s."""
    values: Array = legvander(_place(times, *segment), count - 1)
    return values


def extrapolated(coefficients: Array, before: Array, segment: Array) -> Array:
    """Return the coefficients (D, L) of the linear extrapolation of a segment into the next one.

    The line is the best fit to the previous polynomial over the overlap, because the slope at the end of a
    polynomial is its least certain value.

    Args:
        coefficients: (D, L) of the previous segment.
        before, segment: (2,) s, the previous and the next segment.
    """
    nodes, weights = leggauss(coefficients.shape[1] + 1)
    middle, half = 0.5 * (segment[0] + before[1]), 0.5 * (before[1] - segment[0])
    values = coefficients @ basis(middle + half * nodes, before, coefficients.shape[1]).T
    slope = 1.5 * values @ (weights * nodes) / half
    found = np.zeros_like(coefficients)
    found[:, 0] = 0.5 * values @ weights + slope * (segment.mean() - middle)
    found[:, 1] = slope * 0.5 * (segment[1] - segment[0])
    return found


def _place(times: Array, first: Array | float, last: Array | float) -> Array:
    """Return the places of times (s) in a segment: -1 at its first instant, 1 at its last one."""
    places: Array = (2.0 * times - first - last) / (last - first)
    return places
