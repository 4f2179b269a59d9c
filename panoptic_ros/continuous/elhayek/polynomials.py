"""Motion functions: polynomials in overlapping segments of time, blended to one curve (paper, 4.2 and 4.4.1).

A polynomial is a sum of Legendre polynomials of the place u in its segment, -1..1. They are orthogonal, so
the coefficients of an uneven set of instants stay well conditioned.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial.legendre import leggauss, legval, legvander

Array = np.ndarray
# Degrees of the polynomials; the paper says "low". With 2D joints the fourth one follows a run at 2.5 times the tempo of
# walking, which a cubic does not. Images alone say less: with a fourth degree, legs that pass change places.
DEGREE, IMAGE_DEGREE = 4, 3
FRAMES = 2.0  # length of a segment, in frames of the slowest camera (paper, 5)
OVERLAP = 0.6  # share of a segment that it has in common with the previous one (paper, 5)
MARGIN = 0.02  # share of a segment by which all segments together exceed the views, because weights end at 0


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
        times = np.clip(times, self.segments[0, 0], self.segments[-1, 1])
        weights = self.weights(times)
        values = np.zeros((len(times), self.coefficients.shape[1]))
        for (first, last), own, weight in zip(self.segments, self.coefficients, weights):
            inside = weight > 0.0
            if inside.any():
                places = place(times[inside], first, last)
                values[inside] += weight[inside, None] * (basis(places, own.shape[1]) @ own.T)
        return values

    def weights(self, times: Array) -> Array:
        """Return the weights (G, T) of the segments at times (T,) s; their sum is 1."""
        first, last = self.segments[:, 0], self.segments[:, 1]
        edge = 1e-3 * (last[0] - first[0])  # at the outer ends all weights are 0
        inside = np.clip(times, first[0] + edge, last[-1] - edge)
        raw = wendland(np.abs(place(inside, first[:, None], last[:, None])))
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
    room = last - first - length
    count = max(1, int(np.ceil(room / (length * (1.0 - OVERLAP)) - 1e-9)) + 1)
    starts = first + np.linspace(0.0, max(room, 0.0), count)
    return np.stack([starts, starts + length], axis=1)


def place(times: Array, first: Array | float, last: Array | float) -> Array:
    """Return the places of times (s) in a segment: -1 at its first instant, 1 at its last one."""
    places: Array = (2.0 * times - first - last) / (last - first)
    return places


def basis(places: Array, count: int) -> Array:
    """Return the values (T, count) of the first Legendre polynomials at places (T,)."""
    values: Array = legvander(places, count - 1)
    return values


def gauss_points(count: int) -> tuple[Array, Array]:
    """Return places (count,) and weights (count,) of Gauss's rule; the weights add up to 2."""
    places, weights = leggauss(count)
    return places, weights


def extrapolated(coefficients: Array, before: Array, segment: Array) -> Array:
    """Return the coefficients (D, L) of the linear extrapolation of a segment into the next one.

    The line is the best fit to the previous polynomial over the overlap, because the slope at the very end of
    a polynomial is its least certain value.

    Args:
        coefficients: (D, L) of the previous segment.
        before, segment: (2,) s, the previous and the next segment.
    """
    mean, slope, middle, half = _line(coefficients, before, segment)
    centre, reach = 0.5 * (segment[0] + segment[1]), 0.5 * (segment[1] - segment[0])
    found = np.zeros_like(coefficients)
    found[:, 0] = mean + slope * (centre - middle) / half
    found[:, 1] = slope * reach / half
    return found


def held(coefficients: Array, before: Array, segment: Array) -> Array:
    """Return the coefficients (D, L) of a segment that keeps the mean of the previous one over the overlap.

    Args:
        coefficients, before, segment: see `extrapolated`.
    """
    found = np.zeros_like(coefficients)
    found[:, 0] = _line(coefficients, before, segment)[0]
    return found


def _line(coefficients: Array, before: Array, segment: Array) -> tuple[Array, Array, float, float]:
    """Return the best line over the overlap: mean (D,), slope (D,) per half overlap, its middle and half (s)."""
    nodes, weights = gauss_points(coefficients.shape[1] + 1)
    middle, half = 0.5 * (segment[0] + before[1]), 0.5 * (before[1] - segment[0])
    values = legval(place(middle + half * nodes, *before), coefficients.T)  # (D, Q)
    return 0.5 * values @ weights, 1.5 * values @ (weights * nodes), middle, half
