"""The places of a word's edges on a tape whose speed wanders: a smoothing spline, as a Kalman smoother.

The change of the speed is a random walk from cell to cell, so the best curve through noisy edges is a
smoothing spline of fifth order (Wecker and Ansley 1983). How fast it wanders is a bandwidth: the corner, in
radians per cell, above which the smoother takes the motion of edges for noise. Which bandwidth a tape has the
innovations say: each of some is scored by its likelihood, in which the scale of the noise is free.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.kernels import njit

Array = np.ndarray
_jit = njit(cache=True, error_model="numpy", nogil=True)
BANDWIDTHS = 0.015 * 1.5 ** np.arange(12)  # radians per cell: from 5 to 500 Hz or so
ROW = 9  # values that are kept of each edge on the way there, for the way back


class Motion(NamedTuple):
    """What is known of the tape at a place: its position, speed and turn.

    Args:
        cell: from the middle of a word.
        place: samples. speed, turn: samples per cell, and its change per cell.
        spread: (6,) upper triangle of their covariance, in units of the noise's scale.
    """

    cell: float
    place: float
    speed: float
    turn: float
    spread: Array


class Smoothed(NamedTuple):
    """Edges by all that is known of them.

    Args:
        places: (N,) samples.
        variances: (N,) of them, in units of the noise's scale.
        nats: log likelihood with the scale of the noise that fits best.
        scale: that.
        end: the motion after the last but one edge, at the last.
    """

    places: Array
    variances: Array
    nats: float
    scale: float
    end: Motion


@_jit
def smooth(cells: Array, measured: Array, noise: Array, before: Motion, bandwidth: float) -> Smoothed:
    """The places of edges.

    Args:
        cells: (N,) of the edges, from the middle of the word.
        measured: (N,) samples. noise: (N,) variances.
        before: the motion before the first edge.
        bandwidth: see above.
    """
    count = len(cells)
    wander = _wander(cells, noise, bandwidth)
    kept, square, logs, end = _there(cells, measured, noise, before, wander)
    places, variances = _back(cells, kept)
    for k in range(count):
        places[k] += before.place + before.speed * (cells[k] - before.cell)
    scale = square / count
    return Smoothed(places, variances, -0.5 * (count * np.log(scale) + logs), scale, end)


@_jit
def likelihoods(cells: Array, measured: Array, noise: Array, before: Motion, bandwidths: Array) -> Array:
    """The log likelihoods (B,) of some bandwidths, see `smooth`."""
    nats, count = np.empty(len(bandwidths)), len(cells)
    for i in range(len(bandwidths)):
        wander = _wander(cells, noise, bandwidths[i])
        _, square, logs, _ = _there(cells, measured, noise, before, wander)
        nats[i] = -0.5 * (count * np.log(square / count) + logs)
    return nats


@_jit
def _wander(cells: Array, noise: Array, bandwidth: float) -> float:
    """The spectral density of the turn's changes whose smoother has a bandwidth."""
    density: float = bandwidth**6 * (cells[-1] - cells[0]) / (1.0 / noise).sum()
    return density


@_jit
def _there(
    cells: Array, measured: Array, noise: Array, before: Motion, wander: float
) -> tuple[Array, float, float, Motion]:
    """From edge to edge: rows (N, `ROW`) for the way back, and what the likelihood needs."""
    count = len(cells)
    kept = np.empty((count, ROW))
    at, place, speed, turn = before.cell, 0.0, 0.0, before.turn
    a, b, c, e, f, g = before.spread
    square, logs, end = 0.0, 0.0, before
    for k in range(count):
        h = cells[k] - at
        at = cells[k]
        place += h * speed + 0.5 * h * h * turn
        speed += h * turn
        a += h * (2.0 * b + h * (c + e + h * (f + 0.25 * h * g))) + wander * h**5 / 20.0
        b += h * (c + e + h * (1.5 * f + 0.5 * h * g)) + wander * h**4 / 8.0
        c += h * (f + 0.5 * h * g) + wander * h**3 / 6.0
        e += h * (2.0 * f + h * g) + wander * h**3 / 3.0
        f += h * g + wander * h * h / 2.0
        g += wander * h
        even = before.place + before.speed * (at - before.cell)
        if k == count - 1:
            spread = np.array([a, b, c, e, f, g])
            end = Motion(at, even + place, before.speed + speed, turn, spread)
        news, spread_here = measured[k] - even - place, a + noise[k]
        square += news * news / spread_here
        logs += np.log(spread_here)
        p, q, r = a / spread_here, b / spread_here, c / spread_here
        place += p * news
        speed += q * news
        turn += r * news
        e -= q * b
        f -= q * c
        g -= r * c
        a, b, c = a - p * a, b - p * b, c - p * c
        row = kept[k]
        row[0], row[1], row[2], row[3] = place, a, b, c
        row[4], row[5], row[6], row[7], row[8] = p, q, r, news / spread_here, 1.0 / spread_here
    return kept, square, logs, end


@_jit
def _back(cells: Array, kept: Array) -> tuple[Array, Array]:
    """Improve edges by those after them (Bryson and Frazier): places and variances (N,)."""
    count = len(cells)
    places, variances = np.empty(count), np.empty(count)
    x, y, z = 0.0, 0.0, 0.0  # what later edges say against the state here
    a, b, c, e, f, g = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0  # and their information
    for k in range(count - 1, -1, -1):
        place, pa, pb, pc, p, q, r, news, weight = kept[k]
        places[k] = place - (pa * x + pb * y + pc * z)
        u, v, w = a * pa + b * pb + c * pc, b * pa + e * pb + f * pc, c * pa + f * pb + g * pc
        variances[k] = max(pa - (pa * u + pb * v + pc * w), 0.0)
        if k == 0:
            break
        x = (1.0 - p) * x - q * y - r * z - news
        u = (1.0 - p) * a - q * b - r * c
        b = (1.0 - p) * b - q * e - r * f
        c = (1.0 - p) * c - q * f - r * g
        a = (1.0 - p) * u - q * b - r * c + weight
        h = cells[k] - cells[k - 1]
        z += h * y + 0.5 * h * h * x
        y += h * x
        u, v = 0.5 * h * h * a + h * b + c, 0.5 * h * h * b + h * e + f
        g += 0.5 * h * h * (u + c) + h * (v + f)
        f = h * u + v
        e += h * (2.0 * b + h * a)
        b += h * a
        c = u
    return places, variances
