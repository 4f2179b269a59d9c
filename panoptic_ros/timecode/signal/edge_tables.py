"""Tables of the step response: the guess, and the corrections that may be learnt."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

Array = np.ndarray
PHASES = 32  # places between two samples
EDGE_SECONDS = 15.6e-6  # standard deviation of an edge of 40 us rise time
BAND = 0.465  # cycles per sample that a recorder lets pass


@lru_cache(maxsize=8)
def step_guess(sample_rate: int, reach: int) -> Array:
    """(2, P + 1, 2 R): a Gaussian edge behind a low pass, less its sign; its slope."""
    sigma = EDGE_SECONDS * sample_rate * PHASES
    half = 4 * reach * PHASES
    at = np.arange(-half, half + 1) / PHASES
    low_pass = np.sinc(2.0 * BAND * at) * np.kaiser(len(at), 8.0)
    near = np.arange(-int(6.0 * sigma) - 1, int(6.0 * sigma) + 2)
    density = np.convolve(low_pass, np.exp(-0.5 * (near / sigma) ** 2), mode="same")
    level = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]))])
    density, level = 2.0 * density * PHASES / level[-1], 2.0 * level / level[-1] - 1.0
    places = _places(reach)
    sign = np.where(np.arange(2 * reach) >= reach, 1.0, -1.0)
    table = np.stack([np.interp(places, at, level) - sign, np.interp(places, at, density)])
    table.flags.writeable = False
    return table


@lru_cache(maxsize=8)
def spline_tables(reach: int, knot: float) -> Array:
    """(J, 2, P + 1, 2 R): cubic B-splines inside of the reach and their slopes."""
    from scipy.interpolate import BSpline  # takes long to load, which most runs do not need

    places = _places(reach)
    knots = np.arange(-reach, reach + 0.5 * knot, knot)
    out = []
    for first in range(len(knots) - 4):
        spline = BSpline.basis_element(knots[first : first + 5], extrapolate=False)
        value = np.nan_to_num(spline(places))
        out.append(np.stack([value, _slope(value)]))
    table = np.array(out)
    table.flags.writeable = False
    return table


def kinds_of(count: int, knot: float) -> Array:
    """Projections (3, J, J) on odd and even corrections and on what lies beyond the band."""
    one, flip = np.eye(count), np.eye(count)[::-1]
    band = min(1.0, 2.0 * BAND * knot)
    apart = np.arange(count)[:, None] - np.arange(count)
    return np.stack([0.5 * (one - flip), 0.5 * (one + flip), one - band * np.sinc(band * apart)])


@lru_cache(maxsize=8)
def moves_of(sample_rate: int, reach: int, knot: float) -> Array:
    """How far each correction and the droop would move the guess (J + 1,), up to a common factor."""
    slope = step_guess(sample_rate, reach)[1]
    return np.append((spline_tables(reach, knot)[:, 0] * slope).sum(axis=(1, 2)), 0.0)


def _places(reach: int) -> Array:
    """Distances from an edge, (P + 1, 2 R), samples."""
    return np.arange(-reach, reach) + np.arange(PHASES + 1)[:, None] / PHASES


def _slope(table: Array) -> Array:
    """Derivative of a continuous table (P + 1, 2 R)."""
    line = np.append(table[:-1].T.ravel(), table[-1, -1])
    slope = np.gradient(line, 1.0 / PHASES)
    inner = slope[:-1].reshape(-1, PHASES).T
    return np.vstack([inner, np.append(inner[0, 1:], slope[-1])])
