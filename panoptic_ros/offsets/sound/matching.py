"""Find the lag at which one recording contains a part of another, and test if that lag is unique."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

Array = np.ndarray
RATE = 100.0  # Hz, rate of coarse onsets
# s, length of the energy windows; s, time of a rise; quantile that is the floor (see `onsets`)
LENGTH_S, RISE_S, LEVEL = 0.025, 0.02, 0.5
LEAST_S = 5.0  # s that two recordings must share
ECHO_S = 0.25  # s, distance from a peak of the agreement within which other peaks are its echoes
# minimum agreement at a unique lag, in robust standard deviations of the agreement over all lags
STRONG = 8.0
EXPECTED = 5.5  # minimum agreement at a lag that is known to within a second, in the same unit as STRONG
UNIQUE = 1.6  # minimum ratio of the agreement at a unique lag to that at any other lag
EVENTS = 3.5  # minimum effective number of matching events: single bangs in two rooms also agree at one lag
BLOCK_S = 0.25  # s, duration of an event
NORMAL_MEDIAN = 0.6745  # median of |x| for a standard normal x


@dataclass(frozen=True)
class LagMatch:
    """Lag of the best agreement of two recordings.

    Args:
        lag: (s) time in the whole minus time in the part, see `find`.
        at: (s) middle of the agreeing sound, in the part.
        strength: (robust standard deviations over all lags) agreement at the lag.
        ratio: agreement over that at the next best lag.
        events: effective number of agreeing events.
        other: (s) next best lag.
    """

    lag: float
    at: float
    strength: float
    ratio: float
    events: float
    other: float

    @property
    def unique(self) -> bool:
        """Return whether the lag is beyond doubt."""
        return self.strength >= STRONG and self.ratio >= UNIQUE and self.events >= EVENTS

    @property
    def expected(self) -> bool:
        """Return whether the match is sufficient if the lag is already known to within a second."""
        return self.strength >= EXPECTED and self.events >= EVENTS


def find(part: Array, whole: Array, near: float | None = None, within: float = 0.0) -> LagMatch | None:
    """Find the onsets of a part (T, B) in a whole (U, B), at whole = part + lag.

    Args:
        near, within: (s) centre and half width of the range of lags to search, if known.

    Returns: the match; None if the shared time is too short, or there is only silence.
    """
    first, last = 0, len(whole)
    if near is not None:
        first = max(0, int((near - within) * RATE))
        last = min(len(whole), int((near + within) * RATE) + len(part))
        whole = whole[first:last]
    if min(len(part), len(whole)) < LEAST_S * RATE:
        return None
    # imported here: loading takes about a second, and most runs do not need it
    from scipy.signal import oaconvolve

    lags = np.arange(1 - len(part), len(whole))
    shared = np.minimum(len(whole), lags + len(part)) - np.maximum(0, lags)
    agreement = np.zeros(len(lags))
    for band in range(part.shape[1]):
        agreement += oaconvolve(whole[:, band], part[::-1, band])
    usable = shared >= min(LEAST_S * RATE, 0.5 * len(part))
    agreement = np.where(usable, agreement / np.sqrt(np.maximum(shared, 1)), 0.0)
    noise = float(np.median(np.abs(agreement[usable]))) / NORMAL_MEDIAN
    if noise <= 0.0:
        return None  # silence
    asked = usable if near is None else usable & (np.abs(lags + first - near * RATE) <= within * RATE)
    if not asked.any():
        return None
    best = int(np.argmax(np.where(asked, agreement, -np.inf)))
    echo = round(ECHO_S * RATE)
    others = agreement.copy()
    others[max(0, best - echo) : best + echo + 1] = 0.0
    other = int(np.argmax(others))
    ratio = float(agreement[best] / max(others[other], noise))
    events, at = _events(part, whole, int(lags[best]))
    fine = vertex(agreement, best)
    return LagMatch(
        (float(lags[best]) + fine + first) / RATE,
        at,
        float(agreement[best]) / noise,
        ratio,
        events,
        float(lags[other] + first) / RATE,
    )


def vertex(values: Array, best: int) -> float:
    """Return the offset from a peak to the vertex of the parabola through it and its neighbours, samples."""
    if not 0 < best < len(values) - 1:
        return 0.0
    before, peak, after = values[best - 1 : best + 2]
    bend = before - 2.0 * peak + after
    return float(0.5 * (before - after) / bend) if bend < 0.0 else 0.0


def _events(part: Array, whole: Array, lag: int) -> tuple[float, float]:
    """Return the effective number of time blocks that agree at a lag, and their centre in the part (s)."""
    begin, end = max(0, -lag), min(len(part), len(whole) - lag)
    products = (part[begin:end] * whole[begin + lag : end + lag]).sum(axis=1)
    step = round(BLOCK_S * RATE)
    blocks = products[: len(products) // step * step].reshape(-1, step).sum(axis=1)
    power = float((blocks**2).sum())
    if power <= 0.0:
        return 0.0, begin / RATE
    weight = np.maximum(blocks, 0.0)
    middle = float(weight @ (np.arange(len(blocks)) + 0.5)) / max(float(weight.sum()), 1e-12)
    return float(blocks.sum()) ** 2 / power, begin / RATE + middle * BLOCK_S
