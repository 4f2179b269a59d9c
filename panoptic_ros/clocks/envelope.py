"""Fit the lower envelope of points with one-way delays: transport makes timestamps late, never early.

The model is y_k = offset + slope x_k + d_k with d_k >= 0. Least squares estimates the mean delay, which
changes with the system load. The closest line below all points does not depend on the load. It is the edge of
the lower convex hull below the mean of x (Moon, Skelly, Towsley, INFOCOM 1999; Zhang, Liu, Xia, INFOCOM
2002). A single early timestamp would pull the line down. Therefore outliers far below all other points are
removed first.
"""

from __future__ import annotations

import numpy as np

from panoptic_ros.clocks.line import Line

Array = np.ndarray
LEAST_POINTS = 8  # minimum number of points for the removal of early ones
EARLY_SHARE = 0.01  # maximum share of points removed as early; at least two points
# a point is early if it is farther below the line than this times the lowest points' spacing
EARLY_FACTOR = 6.0
# minimum ratio of the line's std to the delay scatter: whole-ms timestamps cluster on the line
LEAST_SHARE = 0.02
LOW_SHARE = 0.05  # share of the lowest points, which measure the point density near the line


def fit_lower_line(x: Array, y: Array) -> Line:
    """Fit the line below the points; its covariance follows from the point density near it.

    Args:
        x, y: (N,) N >= 2 different x, s.
    """
    kept = np.ones(len(x), bool)
    solution = _supporting_edge(x, y)
    for _ in range(max(2, int(EARLY_SHARE * len(x))) if len(x) >= LEAST_POINTS else 0):
        support = np.flatnonzero(kept)[np.argsort(_above(solution, x[kept], y[kept]), kind="stable")[:2]]
        without = [_without(x, y, kept, point) for point in support]
        distances = [_above(line, x[[p]], y[[p]])[0] for line, p in zip(without, support)]
        worst = int(np.argmin(distances))
        others = kept.copy()
        others[support[worst]] = False
        if -distances[worst] <= EARLY_FACTOR * _low_distance(without[worst], x[others], y[others]):
            break
        kept, solution = others, without[worst]
    return _with_covariance(solution, x[kept], y[kept])


def _without(x: Array, y: Array, kept: Array, point: int) -> tuple[float, float]:
    others = kept.copy()
    others[point] = False
    return _supporting_edge(x[others], y[others])


def _supporting_edge(x: Array, y: Array) -> tuple[float, float]:
    """Return offset and slope of the lower hull's edge below the mean of x."""
    order = np.lexsort((y, x))
    hull: list[int] = []
    for k in order:
        while len(hull) >= 2 and _turns_down(x, y, hull[-2], hull[-1], k):
            hull.pop()
        if not hull or x[k] > x[hull[-1]]:
            hull.append(int(k))
    middle = float(x.mean())
    right = next((i for i in range(1, len(hull)) if x[hull[i]] >= middle), len(hull) - 1)
    a, b = hull[right - 1], hull[right]
    slope = float((y[b] - y[a]) / (x[b] - x[a]))
    return float(y[a] - slope * x[a]), slope


def _turns_down(x: Array, y: Array, a: int, b: int, c: int) -> bool:
    """Return whether b lies on or above the chord from a to c."""
    return bool((y[b] - y[a]) * (x[c] - x[a]) >= (y[c] - y[a]) * (x[b] - x[a]))


def _above(line: tuple[float, float], x: Array, y: Array) -> Array:
    return y - line[0] - line[1] * x


def _low_distance(line: tuple[float, float], x: Array, y: Array) -> float:
    """Return the mean spacing (s) of the lowest points above the line, which is the line's uncertainty."""
    count = max(4, int(LOW_SHARE * len(x)))
    distances = np.sort(_above(line, x, y))[: count + 2]
    return max(float(distances[-1]) / max(1, len(distances) - 2), 1e-7)


def _with_covariance(solution: tuple[float, float], x: Array, y: Array) -> Line:
    """Return the line with its covariance, from the density of the lowest points.

    The smallest of n delays with density f at zero has mean and standard deviation 1 / (n f). A line rests on
    two of them, and short delays are rarer than that density suggests. Therefore the standard deviation of
    the offset in the middle is taken as four times 1 / (n f). That of the slope is the same value divided by
    a quarter of the span.
    """
    noise = float(np.std(_above(solution, x, y)))
    deviation = max(4.0 * _low_distance(solution, x, y), LEAST_SHARE * noise)
    middle, span = float(x.mean()), max(float(np.ptp(x)), 1e-9)
    slope_deviation = deviation / (0.25 * span)
    covariance = np.array(
        [
            [deviation**2 + (middle * slope_deviation) ** 2, -middle * slope_deviation**2],
            [-middle * slope_deviation**2, slope_deviation**2],
        ]
    )
    return Line(*solution, covariance, noise)
