"""Estimate one offset and drift per device, from lags between pairs of devices."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

Array = np.ndarray
PRIOR_DRIFT = 7e-5  # standard deviation of the drift of crystals
CAUCHY = 3.0  # standard deviations beyond which an observation is down-weighted
ROUNDS = 12
PLACES = 4.0  # maximum number of independent source positions: people stay where they are
KEPT_S = 10.0  # s for which the source of sound stays at one position
NOISE_S = 2e-3  # s, minimum noise of the arrival at a device in one window
STRAY = 4.0  # standard deviations beyond which a window is dropped
LOOP_S = 0.01  # s, tolerance of the sum of the lags of three devices for one sound, which echoes move off 0
FEWEST = 3  # minimum number of windows to estimate the variation of travel times


@dataclass(frozen=True, eq=False)
class Lags:
    """N lags: the second device receives a sound `lag` s later than the first, by their sample counts.

    Args:
        first, second: (N,) indices of devices.
        times: (N,) s, sample time of the first device.
        lags: (N,) s.
        deviations: (N,) s, standard deviations.
    """

    first: Array
    second: Array
    times: Array
    lags: Array
    deviations: Array


@dataclass(frozen=True, eq=False)
class SoundClockLines:
    """Sample times of D devices: heard = common - offsets - drifts (common - middle), in s; NaN = not linked.

    Args:
        offsets: (D,) s.
        drifts: (D,) dimensionless.
        middle: (s) middle of the common time line, which is that of the first linked device.
    """

    offsets: Array
    drifts: Array
    middle: float

    def heard(self, common: Array) -> Array:
        """Return the sample times (D, K) s of the common times (K,)."""
        since = common - self.middle
        return np.asarray(common - self.offsets[:, None] - self.drifts[:, None] * since)


def fit_lines(count: int, members: Array, lags: Lags) -> SoundClockLines:
    """Fit offsets and drifts of the linked devices relative to the first one, by robust least squares.

    Args:
        count: number of devices D.
        members: indices of the linked devices; the lags must link all of them.
    """
    offsets, drifts = np.full(count, np.nan), np.full(count, np.nan)
    offsets[members] = drifts[members] = 0.0
    free, middle = members[1:], 0.0
    column = np.full(count, -1)
    column[free] = np.arange(len(free))
    unknown = len(free)
    scale = 1.0 / lags.deviations
    for step in range(ROUNDS):
        common = lags.times + offsets[lags.first]
        middle = float(np.median(common))
        since = common - middle
        design = np.zeros((len(lags.lags), 2 * unknown))
        for device, sign in ((lags.first, 1.0), (lags.second, -1.0)):
            rows = np.flatnonzero(column[device] >= 0)
            design[rows, column[device[rows]]] = sign
            design[rows, unknown + column[device[rows]]] = sign * since[rows]
        miss = (lags.lags - design @ np.concatenate([offsets[free], drifts[free]])) * scale
        weight = scale / np.sqrt(1.0 + (miss / CAUCHY) ** 2) if step > 1 else scale
        prior = np.zeros(2 * unknown)
        prior[unknown:] = PRIOR_DRIFT**-2.0
        solved = design * weight[:, None]
        state = np.linalg.solve(solved.T @ solved + np.diag(prior), solved.T @ (weight * lags.lags))
        offsets[free], drifts[free] = state[:unknown], state[unknown:]
    return SoundClockLines(offsets, drifts, middle)


def arrivals(first: Array, second: Array, lags: Array, weights: Array, count: int) -> Array:
    """Return arrival times (count,) s in one window, with mean 0 over linked devices; NaN for others."""
    found = np.full(count, np.nan)
    linked = largest_group(count, first, second)
    if len(linked) < 2:
        return found
    inside = np.isin(first, linked)
    rows = np.arange(int(inside.sum()))
    place = np.full(count, -1)
    place[linked] = np.arange(len(linked))
    design = np.zeros((len(rows), len(linked)))
    design[rows, place[second[inside]]] = 1.0
    design[rows, place[first[inside]]] -= 1.0
    lag, scale = lags[inside], weights[inside]
    miss = np.zeros(len(rows))
    for _ in range(6):
        weight = scale / np.sqrt(1.0 + (miss / (CAUCHY * 2.0 * NOISE_S)) ** 2)
        solved = np.linalg.lstsq(design * weight[:, None], weight * lag, rcond=1e-9)[0]
        miss = lag - design @ solved
    found[linked] = solved - solved.mean()
    return found


def loops_close(first: Array, second: Array, lags: Array, count: int) -> Array:
    """Return which pairs (P,) of devices a third device confirms: the three lags of a window add up to 0.

    Chance peaks lie at any lag. In 40 s of talk and claps, 10 to 60 % of the lags in no loop are false.

    Args:
        first, second: (P,) devices, first < second.
        lags: (P,) s.
    """
    table = np.full((count, count), np.nan)
    table[first, second], table[second, first] = lags, -lags
    misses = np.abs(table[first] + table[:, second].T - lags[:, None])
    confirmed: Array = (np.nan_to_num(misses, nan=np.inf) < LOOP_S).any(axis=1)
    return confirmed


def largest_group(count: int, first: Array, second: Array) -> Array:
    """Return the indices of the largest linked group of devices; any one of several equal groups."""
    group = np.arange(count)
    for a, b in zip(first, second):
        group[group == group[b]] = group[a]
    sizes = np.bincount(group, minlength=count)
    return np.flatnonzero(group == sizes.argmax())


@dataclass(frozen=True, eq=False)
class LineEstimate:
    """Lines with the covariance (2D, 2D) of (offsets, drifts), before the choice of the reference clock."""

    lines: SoundClockLines
    covariance: Array
    residuals: Array  # (D, K) s


def settle(
    lines: SoundClockLines, times: Array, arrived: Array, travel: Array, spread: Array
) -> LineEstimate:
    """Return the lines corrected by K windows, with their covariance.

    Every source position adds its own travel delays. The part that all windows share cannot be distinguished
    from clock offsets. Let s^2 be the variance of the delays over the windows, and S that over all possible
    source positions. The mean over the actual positions then has an error of variance S - s^2, for one
    position (s = 0) as for many. Delays that vary stay the same for some seconds.

    Args:
        lines: initial lines.
        times: (K,) s, windows on the common time line.
        arrived: (D, K) s, arrival times relative to these lines; NaN without sound.
        travel: (D, K) or (D, 1) s, expected travel delays, see `travel.SourcePositions`.
        spread: (D, D) s^2, covariance of the travel delays, see `travel.SourcePositions`.
    """
    members = np.flatnonzero(np.isfinite(lines.offsets))
    count = len(lines.offsets)
    gauge = np.eye(len(members)) - 1.0 / len(members)
    spread = gauge @ spread[np.ix_(members, members)] @ gauge.T
    expected = travel[members] - travel[members].mean(axis=0)
    measured = arrived[members] - expected
    since = times - lines.middle
    variance = np.diag(spread)
    # relative to the mean of all devices
    noise = NOISE_S**2 * (1.0 - 1.0 / len(members)) / float(variance.mean())
    effects = _DelayVariances(1.0, 0.0, noise)
    state = np.zeros((len(members), 2))
    cover = np.zeros((len(members), 2, 2))
    shift = np.zeros(len(times))
    for _ in range(4):
        for i in range(len(members)):
            state[i], cover[i] = _line(measured[i] - shift, since, variance[i], effects)
        model = state[:, :1] + state[:, 1:] * since
        shift = np.nan_to_num(_mean(measured - model))
        miss = _without_strays(measured - model - shift, np.sqrt(variance))
        measured = np.where(np.isfinite(miss), measured, np.nan)
        effects = _DelayVariances.of(miss / np.sqrt(variance)[:, None], noise)
    offsets, drifts = lines.offsets.copy(), lines.drifts.copy()
    offsets[members] -= state[:, 0]
    drifts[members] -= state[:, 1]
    residuals = np.full(arrived.shape, np.nan)
    residuals[members] = miss
    root = np.sqrt(variance)
    alike = spread / np.outer(root, root)
    covariance = np.zeros((2 * count, 2 * count))
    for p in range(2):
        for q in range(2):
            block = alike * np.sqrt(np.abs(np.outer(cover[:, p, q], cover[:, p, q])))
            block *= np.sign(cover[:, p, q])[:, None]
            covariance[np.ix_(p * count + members, q * count + members)] = 0.5 * (block + block.T)
    return LineEstimate(SoundClockLines(offsets, drifts, lines.middle), covariance, residuals)


@dataclass(frozen=True)
class _DelayVariances:
    """Variance components of a delay, in units of its variance over all source positions.

    Args:
        shared: Variance of the part common to all windows.
        kept: Variance of the part that stays the same for some seconds.
        own: Variance of the independent part of each window.
    """

    shared: float
    kept: float
    own: float

    @classmethod
    def of(cls, miss: Array, noise: float) -> _DelayVariances:
        """Estimate the components from residuals (M, K) in units of the delay's standard deviation.

        Args:
            noise: minimum of the component `own`.
        """
        values, steps = miss[np.isfinite(miss)], np.diff(miss, axis=1)
        steps = steps[np.isfinite(steps)]
        windows = len(values) / len(miss)
        if windows < FEWEST or len(steps) < FEWEST:
            return cls(1.0, 0.0, noise)
        whole = float(np.mean(values**2))
        own = min(max(0.5 * float(np.mean(steps**2)), noise), max(whole, noise))
        varies = max(0.0, whole - noise)
        return cls(max(1.0 - varies, max(1.0, varies) / PLACES), max(0.0, whole - own), own)


def _line(values: Array, since: Array, variance: float, effects: _DelayVariances) -> tuple[Array, Array]:
    """Return offset and slope of values (K,), with their covariance (2, 2)."""
    there = np.isfinite(values)
    values, since = values[there], since[there]
    kept = np.exp(-np.abs(since[:, None] - since) / KEPT_S)
    joint = variance * (effects.shared + effects.kept * kept + effects.own * np.eye(len(since)))
    design = np.stack([np.ones(len(since)), since], axis=1)
    gain = np.linalg.solve(joint, design)
    cover = np.linalg.inv(design.T @ gain + np.diag([1e-6, PRIOR_DRIFT**-2.0]))
    state: Array = cover @ (gain.T @ values)
    return state, cover


def _without_strays(miss: Array, roots: Array) -> Array:
    """Return the residuals (M, K), with outliers of each device replaced by NaN."""
    for i, root in enumerate(roots):
        own = miss[i][np.isfinite(miss[i])]
        if len(own):
            middle = float(np.median(own))
            scale = max(float(np.median(np.abs(own - middle))) / 0.6745, root)
            miss[i, np.abs(miss[i] - middle) > STRAY * scale] = np.nan
    return miss


def _mean(values: Array) -> Array:
    there = np.isfinite(values)
    means: Array = np.where(there, values, 0.0).sum(axis=0) / np.maximum(there.sum(axis=0), 1)
    return means
