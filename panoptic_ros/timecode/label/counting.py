"""Propose sequences of consecutive labels from the soft bits of several words, with their frame rates."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from panoptic_ros.domain import FrameRate, Timecode
from panoptic_ros.errors import ClockError
from panoptic_ros.timecode.word.layout import COUNTINGS, DROP_RATE, TABLES

Array = np.ndarray
FAR_NATS = 60.0  # candidates worse than the best by more are dropped as too unlikely
NEAR_FRAMES = 3  # number of frame numbers of the middle word to propose per rate
CLOCK = ("seconds", "minutes", "hours")
MOST_NEAR = 8  # number of hour-minute-second combinations to propose per frame number
RATES = (
    FrameRate(24, Fraction(24000, 1001)),
    FrameRate(24, Fraction(24)),
    FrameRate(25, Fraction(25)),
    FrameRate(30, Fraction(30000, 1001)),
    FrameRate(30, Fraction(30)),
)


@dataclass(frozen=True, slots=True)
class LabelSequence:
    """Sequence of consecutive labels.

    Args:
        rate: way of counting.
        count: frame count of the label of word 0.
        step: increment from word to word, 1 or -1.
    """

    rate: FrameRate
    count: int
    step: int

    def label(self, number: int) -> Timecode:
        """Return the label of word `number`."""
        return Timecode.from_frame_count(self.count + self.step * number, self.rate)


def proposals(soft: Array, step: int) -> Iterator[LabelSequence]:
    """Yield the most likely countings given the soft bits (W, 80) of W words, and neighbouring countings."""
    fields = _FieldScores(soft)
    numbers = np.arange(len(soft))
    reference = len(soft) // 2
    for rate in COUNTINGS[:3]:
        found = []
        for frame in range(rate.nominal):
            frames = frame + step * (numbers - reference)
            score = float(fields.tables["frames"][numbers, frames % rate.nominal].sum())
            labels = fields.nearest(CLOCK, frames // rate.nominal)
            found.append((score + labels[0][0], frame, labels))
        found.sort(reverse=True)
        for _, frame, labels in found[:NEAR_FRAMES]:
            for _, (seconds, minutes, hours) in labels:
                yield from _countings(hours, minutes, seconds, frame, rate, step, reference)


class _FieldScores:
    """Scores of the values of each label field, from the soft bits (W, 80) of W words."""

    def __init__(self, soft: Array):
        self.tables = {name: soft[:, bits] @ rows.T.astype(float) for name, (bits, rows) in TABLES.items()}
        self._found: dict[tuple[str, bytes], list[tuple[float, tuple[int, ...]]]] = {}

    def nearest(self, names: Sequence[str], carry: Array) -> list[tuple[float, tuple[int, ...]]]:
        """Return the most likely values of some label fields, best first, with their scores.

        The values apply to words without carry.

        Args:
            names: fields, lowest first; each increments the next by one after 60.
            carry: (W,) increment of the first field in each word.
        """
        key = (names[0], carry.tobytes())  # cached, because few carries are requested, but often
        if key not in self._found:
            found = sorted(self._candidates(names, carry), reverse=True)[:MOST_NEAR]
            self._found[key] = [item for item in found if item[0] > found[0][0] - FAR_NATS]
        return self._found[key]

    def _candidates(self, names: Sequence[str], carry: Array) -> Iterator[tuple[float, tuple[int, ...]]]:
        own = _carried(self.tables[names[0]], carry)
        best = np.argsort(-own, kind="stable")
        if len(names) == 1:
            yield from ((float(own[value]), (int(value),)) for value in best[:MOST_NEAR])
            return
        turned = (best[:, None] + carry) // 60
        turning = turned.any(axis=1)
        # the other values share one result for the remaining fields
        worth = turning | (np.cumsum(~turning) <= MOST_NEAR)
        for value, onwards in zip(best[worth].tolist(), turned[worth]):
            for score, rest in self.nearest(names[1:], onwards):
                yield float(own[value]) + score, (value, *rest)


def _carried(table: Array, carry: Array) -> Array:
    """Return the total score of all words for each value of a field in words without carry."""
    values = table.shape[1]
    total = np.zeros(values)
    for amount in np.unique(carry):
        total += np.roll(table[carry == amount].sum(axis=0), -int(amount))
    return total


def _countings(
    hours: int, minutes: int, seconds: int, frames: int, rate: FrameRate, step: int, number: int
) -> Iterator[LabelSequence]:
    """Yield the countings in which word `number` has a given label; 30 labels also allow drop-frame."""
    rates = [rate, COUNTINGS[3]] if rate.nominal == 30 else [rate]
    for one in rates:
        try:
            label = Timecode(hours, minutes, seconds, frames, one)
        except ClockError:
            continue
        yield LabelSequence(one, label.frame_count - step * number, step)


def possible_rates(countings: Collection[FrameRate]) -> list[tuple[FrameRate, float]]:
    """Return the frame rates that use one of the given ways of counting, with words per second."""
    nominals = {rate.nominal for rate in countings if not rate.drop_frame}
    rates = [rate for rate in RATES if rate.nominal in nominals]
    if any(rate.drop_frame for rate in countings):
        rates.append(DROP_RATE)
    return [(rate, float(rate.exact)) for rate in rates]


def closest_rate(rates: Sequence[tuple[FrameRate, float]], measured: float) -> FrameRate:
    """Return the frame rate closest to a measured number of words per second."""
    if len(rates) == 1:
        return rates[0][0]
    return min(rates, key=lambda item: abs(math.log(measured / item[1])))[0]


def with_rate(label: Timecode, rate: FrameRate) -> Timecode:
    """Return a label at another frame rate; the label unchanged if that rate has no such label."""
    try:
        return Timecode(label.hours, label.minutes, label.seconds, label.frames, rate)
    except ClockError:
        return label
