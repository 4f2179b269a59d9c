"""Where in one recording a part of another is heard, and whether that is the only place where it can be."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

Array = np.ndarray
RATE = 100.0  # Hz, of coarse onsets
LENGTH_S, RISE_S, LEVEL = 0.025, 0.02, 0.5  # of their windows; over which they rise; see `onsets`
LEAST_S = 5.0  # that two recordings must share
ECHO_S = 0.25  # around a peak, in which others belong to it
STRONG = 8.0  # robust standard deviations of the agreement at other lags that a peak must have
EXPECTED = 5.5  # where it is expected within a second
UNIQUE = 1.6  # times the agreement at any other lag
EVENTS = 3.5  # that must add to it: one bang in each of two rooms agrees at one lag, too
BLOCK_S = 0.25  # of an event
NORMAL_MEDIAN = 0.6745


@dataclass(frozen=True)
class Match:
    """The lag at which two recordings agree best.

    Args:
        lag: s, time in the whole minus time in the part, see `find`.
        at: s in the part, the middle of what agrees.
        strength: its agreement in robust standard deviations of that at all lags.
        ratio: over the agreement at the next best lag.
        events: effective number of them behind it.
        other: s, the next best lag.
    """

    lag: float
    at: float
    strength: float
    ratio: float
    events: float
    other: float

    @property
    def unique(self) -> bool:
        """Whether no other lag can be meant."""
        return self.strength >= STRONG and self.ratio >= UNIQUE and self.events >= EVENTS

    @property
    def expected(self) -> bool:
        """Whether it is enough where the lag is known within a second."""
        return self.strength >= EXPECTED and self.events >= EVENTS


def find(part: Array, whole: Array, near: float | None = None, within: float = 0.0) -> Match | None:
    """Where the onsets of a part (T, B) are in a whole (U, B): at whole = part + lag; None if they cannot be.

    Args:
        near, within: s, where the lag is looked for, if that is known.
    """
    first, last = 0, len(whole)
    if near is not None:
        first = max(0, int((near - within) * RATE))
        last = min(len(whole), int((near + within) * RATE) + len(part))
        whole = whole[first:last]
    if min(len(part), len(whole)) < LEAST_S * RATE:
        return None
    from scipy.signal import oaconvolve  # takes a second to load, which most runs do not need

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
    return Match(
        (float(lags[best]) + fine + first) / RATE,
        at,
        float(agreement[best]) / noise,
        ratio,
        events,
        float(lags[other] + first) / RATE,
    )


def vertex(values: Array, best: int) -> float:
    """Of the parabola through a peak and its neighbours, beside the peak."""
    if not 0 < best < len(values) - 1:
        return 0.0
    before, peak, after = values[best - 1 : best + 2]
    bend = before - 2.0 * peak + after
    return float(0.5 * (before - after) / bend) if bend < 0.0 else 0.0


def _events(part: Array, whole: Array, lag: int) -> tuple[float, float]:
    """Effective number of blocks of time that agree at a lag, and their middle in the part, s."""
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
