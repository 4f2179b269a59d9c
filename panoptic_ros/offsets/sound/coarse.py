"""Where recordings hear the same: lags of pairs of them, by their onsets, at any lag."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from panoptic_ros.offsets.sound.lines import Lags, Lines, fit_lines, largest_group
from panoptic_ros.offsets.sound.matching import EVENTS, RATE, STRONG, Match, find

Array = np.ndarray
SEGMENT_S = 60.0  # of the parts that are looked for in the other recordings
MOST_SEGMENTS = 12
NEAR_S, CHAIN_S = 0.1, 1.0  # reach of lags that another part of two recordings, or other pairs, tell
COARSE_S = 0.01  # standard deviation of a coarse lag
DRIFTS = 3e-4  # that two clocks may differ by


class Coarse:
    """Lags of pairs of recordings, by their onsets, at any lag.

    Args:
        rises: coarse onsets (T, B) of each device.
    """

    def __init__(self, rises: Sequence[Array]):
        self._rises = rises
        self._first: list[int] = []
        self._second: list[int] = []
        self._found: list[Match] = []
        self.why: dict[tuple[int, int], str] = {}
        self.contradicted: dict[tuple[int, int], str] = {}

    def compare(self, a: int, b: int) -> None:
        """Remember the lags at which parts of the shorter recording are in the longer one.

        Where others link the two already, or a part of them has been found, a part is looked for near that
        lag. If it is beyond doubt elsewhere the two contradict each other.
        """
        first, second = (b, a) if len(self._rises[a]) > len(self._rises[b]) else (a, b)
        part, whole = self._rises[first], self._rises[second]
        near = self._predicted(first, second)
        best: Match | None = None
        linked = False
        for begin in _segments(part):
            segment, at = part[begin : begin + round(SEGMENT_S * RATE)], begin / RATE
            if near is not None:
                reach = near.reach + DRIFTS * abs(at - near.at)
                match = find(segment, whole, near.lag + at, reach)
                if match is not None and match.expected:
                    self._remember(first, second, match, at)
                    linked = True
                    continue
            match = find(segment, whole)
            if match is None:
                continue
            if match.unique and near is None:
                near, linked = _Near(match.lag - at, NEAR_S, match.at + at), True
                self._remember(first, second, match, at)
            elif match.unique and near is not None:
                apart = match.lag - at - near.lag
                if abs(apart) > near.reach + DRIFTS * abs(at - near.at):
                    self.contradicted[a, b] = f"after {at:.0f} s it is {apart:+.2f} s off: is sound missing?"
            if best is None or match.strength * match.ratio > best.strength * best.ratio:
                best = match
        if not linked:
            self.why[a, b] = _reason(best)

    def _remember(self, first: int, second: int, match: Match, at: float) -> None:
        self._first.append(first)
        self._second.append(second)
        self._found.append(replace(match, lag=match.lag - at, at=match.at + at, other=match.other - at))

    def _predicted(self, first: int, second: int) -> _Near | None:
        """The lag, if a chain of other pairs links the two."""
        group = self._group(np.arange(len(self._rises)))
        if first not in group or second not in group:
            return None
        lines = self._fit(group)
        middle = 0.5 * len(self._rises[first]) / RATE
        return _Near(float(lines.offsets[first] - lines.offsets[second]), CHAIN_S, middle)

    def _group(self, among: Array) -> Array:
        """The largest group of linked devices among some."""
        first, second = np.array(self._first, int), np.array(self._second, int)
        inside = np.isin(first, among) & np.isin(second, among)
        return largest_group(len(self._rises), first[inside], second[inside])

    def _fit(self, group: Array) -> Lines:
        first, second = np.array(self._first, int), np.array(self._second, int)
        inside = np.isin(first, group) & np.isin(second, group)
        found = [match for match, use in zip(self._found, inside) if use]
        return fit_lines(
            len(self._rises),
            group,
            Lags(
                first[inside],
                second[inside],
                np.array([match.at for match in found]),
                np.array([match.lag for match in found]),
                np.full(len(found), COARSE_S),
            ),
        )

    def lines(self) -> tuple[Lines, Array]:
        """Lines of the largest group of devices that lags link, and its indices.

        Devices are left out, those that contradict most others first, until nobody contradicts another.
        """
        count = len(self._rises)
        kept = np.arange(count)
        while against := [pair for pair in self.contradicted if set(pair) <= set(kept.tolist())]:
            times = np.bincount(np.array(against).ravel(), minlength=count)
            worst = np.flatnonzero(times == times.max())
            kept = np.setdiff1d(kept, worst)
            for pair in against:
                if set(pair) & set(worst.tolist()):
                    self.why.setdefault(pair, self.contradicted[pair])
        group = self._group(kept)
        if len(group) < 2:
            return Lines(np.full(count, np.nan), np.full(count, np.nan), 0.0), group[:0]
        return self._fit(group), group


@dataclass(frozen=True)
class _Near:
    """A lag, s, that is known within a reach, at some time of the first device."""

    lag: float
    reach: float
    at: float


def _segments(rises: Array) -> list[int]:
    """Where segments begin, the most telling first: one in each part of a long recording."""
    length = round(SEGMENT_S * RATE)
    if len(rises) <= 1.5 * length:
        return [0] if len(rises) <= length else [0, len(rises) - length]
    total = np.concatenate([[0.0], np.cumsum(np.maximum(rises, 0.0).sum(axis=1))])
    starts = np.arange(0, len(rises) - length + 1, length // 4)
    told = total[starts + length] - total[starts]
    cells = np.array_split(np.arange(len(starts)), min(MOST_SEGMENTS, max(1, len(rises) // length)))
    chosen = [cell[int(np.argmax(told[cell]))] for cell in cells if len(cell)]
    return [int(starts[k]) for k in sorted(chosen, key=lambda k: -told[k])]


def _reason(best: Match | None) -> str:
    """Why two recordings are not linked, in a few words."""
    if best is None:
        return "silence, or less than 5 s"
    if best.strength < STRONG:
        return "no lag stands out: nothing in common is heard, or it repeats"
    if best.events < EVENTS:
        return "too few sounds in common"
    return f"it repeats: {abs(best.other - best.lag):.2f} s on fits nearly as well"
