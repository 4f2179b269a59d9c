"""One offset and drift for each device, from lags between pairs of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

Array = np.ndarray
PRIOR_DRIFT = 7e-5  # of crystals, standard deviation
CAUCHY = 3.0  # standard deviations from which on an observation counts less
ROUNDS = 12
PLACES = 4.0  # that sound may come from, at most: people stay where they are
KEPT_S = 10.0  # for which who makes a sound stays where he is
NOISE_S = 2e-3  # of what one window tells of a device, at least
STRAY = 4.0  # standard deviations beyond which a window is left out
LOOP_S = 0.01  # by which the lags of three devices may miss closing, those of one sound by echoes
FEWEST = 3  # windows that show how much travel varies


@dataclass(frozen=True, eq=False)
class Lags:
    """N lags: what the first device hears at some time, the second hears `lag` s later by their counts.

    Args:
        first, second: (N,) indices of devices. times: (N,) s, heard by the first. lags: (N,) s.
        deviations: (N,) s.
    """

    first: Array
    second: Array
    times: Array
    lags: Array
    deviations: Array


@dataclass(frozen=True, eq=False)
class Lines:
    """Times heard by D devices: heard = common - offsets - drifts (common - middle), in s; NaN = not linked.

    Args:
        middle: of the common time line, that of the first linked device.
    """

    offsets: Array
    drifts: Array
    middle: float

    def heard(self, common: Array) -> Array:
        """(D, K) times heard of (K,) common times."""
        since = common - self.middle
        return np.asarray(common - self.offsets[:, None] - self.drifts[:, None] * since)


def fit_lines(count: int, members: Array, lags: Lags) -> Lines:
    """Offsets and drifts of the linked devices, relative to the first of them, by robust least squares.

    Args:
        members: indices of the linked devices; lags link them all.
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
    return Lines(offsets, drifts, middle)


def arrivals(first: Array, second: Array, lags: Array, weights: Array, count: int) -> Array:
    """Arrivals (count,) s at devices in one window, of mean 0 over those that lags link; NaN elsewhere."""
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
    """Which pairs (P,) of devices are confirmed by a third, with which their lags in one window add up to 0.

    Peaks of chance lie anywhere. Talk and claps of 40 s: of lags in no loop 10 to 60 % are false.

    Args:
        first, second: (P,) devices, first < second. lags: (P,) s.
    """
    table = np.full((count, count), np.nan)
    table[first, second], table[second, first] = lags, -lags
    misses = np.abs(table[first] + table[:, second].T - lags[:, None])
    confirmed: Array = (np.nan_to_num(misses, nan=np.inf) < LOOP_S).any(axis=1)
    return confirmed


def largest_group(count: int, first: Array, second: Array) -> Array:
    """Indices of the largest group of devices that pairs link; one of them if several are as large."""
    group = np.arange(count)
    for a, b in zip(first, second):
        group[group == group[b]] = group[a]
    sizes = np.bincount(group, minlength=count)
    return np.flatnonzero(group == sizes.argmax())


@dataclass(frozen=True, eq=False)
class Settled:
    """Lines with their covariance (2D, 2D) of (offsets, drifts), before the choice of whose clock counts."""

    lines: Lines
    covariance: Array
    residuals: Array  # (D, K) s


def settle(lines: Lines, times: Array, arrived: Array, travel: Array, spread: Array) -> Settled:
    """Lines corrected by what K windows tell, and how far to trust them.

    The delay of the air is an effect of its own for every place from which sound comes: what all windows
    share of it cannot be told from the clocks. If the delays of windows scatter with variance s^2, and
    those of any place with variance S, then the mean over the places is off with variance S - s^2,
    be they one (s = 0) or many. What varies stays the same for some seconds.

    Args:
        lines: to begin with. times: (K,) s on the common time line.
        arrived: (D, K) s, arrivals beside those lines, NaN = not heard.
        travel, spread: (D, K) or (D, 1) s, and (D, D) s^2, see `travel.Places`.
    """
    members = np.flatnonzero(np.isfinite(lines.offsets))
    count = len(lines.offsets)
    gauge = np.eye(len(members)) - 1.0 / len(members)
    spread = gauge @ spread[np.ix_(members, members)] @ gauge.T
    expected = travel[members] - travel[members].mean(axis=0)
    measured = arrived[members] - expected
    since = times - lines.middle
    variance = np.diag(spread)
    noise = NOISE_S**2 * (1.0 - 1.0 / len(members)) / float(variance.mean())  # beside the mean of all
    effects = _Effects(1.0, 0.0, noise)
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
        effects = _Effects.of(miss / np.sqrt(variance)[:, None], noise)
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
    return Settled(Lines(offsets, drifts, lines.middle), covariance, residuals)


@dataclass(frozen=True)
class _Effects:
    """Variances in units of that of the delay from any place: what all windows share, what stays for some
    seconds, and what each window has of its own."""

    shared: float
    kept: float
    own: float

    @classmethod
    def of(cls, miss: Array, noise: float) -> _Effects:
        """From residuals (M, K) in units of the deviation of the delay; noise: least that is own."""
        values, steps = miss[np.isfinite(miss)], np.diff(miss, axis=1)
        steps = steps[np.isfinite(steps)]
        windows = len(values) / len(miss)
        if windows < FEWEST or len(steps) < FEWEST:
            return cls(1.0, 0.0, noise)
        whole = float(np.mean(values**2))
        own = min(max(0.5 * float(np.mean(steps**2)), noise), max(whole, noise))
        varies = max(0.0, whole - noise)
        return cls(max(1.0 - varies, max(1.0, varies) / PLACES), max(0.0, whole - own), own)


def _line(values: Array, since: Array, variance: float, effects: _Effects) -> tuple[Array, Array]:
    """Offset and slope of values (K,), with their covariance (2, 2)."""
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
    """Residuals (M, K) with NaN where a device's lies far off all others."""
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
