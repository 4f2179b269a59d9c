"""Benchmark of timecode decoders: recall, wrong labels, and errors of the word starts against the truth.

Decoders are functions, and signals include their ground truth. So one table can hold several decoders,
including external ones.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from panoptic_ros.domain import Timecode
from panoptic_ros.errors import DataError

Array = np.ndarray


class TimedSignal(Protocol):
    """Audio (N,) at a sample rate, with the label and the start of each word in samples."""

    @property
    def samples(self) -> Array: ...
    @property
    def sample_rate(self) -> int: ...
    @property
    def labels(self) -> Sequence[Timecode]: ...
    @property
    def starts(self) -> Array: ...


@dataclass(frozen=True, slots=True)
class DecodedWord:
    """Word as a decoder reports it.

    Args:
        label: HH:MM:SS:FF, drop-frame or not.
        start_sample: Fractional sample index of the first edge of bit 0.
        std_samples: Standard deviation of the start, nan if the decoder has none.
    """

    label: str
    start_sample: float
    std_samples: float = float("nan")


Decoder = Callable[[Array, int], Iterable[DecodedWord]]  # samples (N,) float32 and their rate


@dataclass(frozen=True, slots=True)
class TimecodeRow:
    """Scores of one condition; times in microseconds, nan where nothing was read.

    Args:
        words: Number of transmitted words.
        right: Number of words read with the right label within half a word.
        wrong: Number of words reported with another label, or where there is no word.
        twice: Number of repeated reports of a word.
        bias_us, std_us: Mean and standard deviation of the start errors.
        consistency: Root mean square of errors / stated standard deviations; 1 = consistent.
        scatter: The same, after subtracting each signal's mean error.
    """

    condition: str
    words: int
    right: int
    wrong: int
    twice: int
    bias_us: float
    std_us: float
    consistency: float
    scatter: float

    @property
    def recall(self) -> float:
        """Return the share of transmitted words that were read."""
        return self.right / self.words


def timecode_table(
    decoder: Decoder, conditions: Iterable[tuple[str, Sequence[TimedSignal]]]
) -> list[TimecodeRow]:
    """Return one row per condition, over all its signals.

    Args:
        conditions: Names and signals. Signals may be created lazily.

    Raises:
        DataError: If a condition has no words.
    """
    return [_row(condition, decoder, signals) for condition, signals in conditions]


def _row(condition: str, decoder: Decoder, signals: Sequence[TimedSignal]) -> TimecodeRow:
    words = sum(len(signal.labels) for signal in signals)
    if not words:
        raise DataError(f"the timecode condition {condition!r} has no words")
    counts = np.zeros(3, np.int64)
    errors: list[float] = []
    ratios: list[float] = []
    centred: list[float] = []
    for signal in signals:
        right, wrong, twice = _score(signal, decoder(signal.samples, signal.sample_rate))
        counts += (len(right), wrong, twice)
        scale = 1e6 / signal.sample_rate
        errors += [scale * error for error, _ in right]
        ratios += [error / std for error, std in right if std > 0.0]
        middle = float(np.mean([error for error, _ in right])) if right else 0.0
        centred += [(error - middle) / std for error, std in right if std > 0.0]
    return TimecodeRow(
        condition=condition,
        words=words,
        right=int(counts[0]),
        wrong=int(counts[1]),
        twice=int(counts[2]),
        bias_us=float(np.mean(errors)) if errors else float("nan"),
        std_us=float(np.std(errors)) if errors else float("nan"),
        consistency=_rms(ratios),
        scatter=_rms(centred),
    )


def _rms(values: list[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if values else float("nan")


def _score(signal: TimedSignal, decoded: Iterable[DecodedWord]) -> tuple[list[tuple[float, float]], int, int]:
    """Return the start errors of the right words, and the numbers of wrong and repeated words.

    Each right word has (error, stated standard deviation) in samples.
    """
    starts = np.asarray(signal.starts)
    lengths = np.diff(np.sort(starts))
    reach = 0.5 * float(np.median(lengths)) if len(lengths) else np.inf
    right: dict[int, tuple[float, float]] = {}
    wrong = twice = 0
    for word in decoded:
        nearest = int(np.argmin(np.abs(starts - word.start_sample)))
        error = word.start_sample - float(starts[nearest])
        if abs(error) > reach or _plain(word.label) != _plain(str(signal.labels[nearest])):
            wrong += 1
        elif nearest in right:
            twice += 1
        else:
            right[nearest] = error, word.std_samples
    return list(right.values()), wrong, twice


def _plain(label: str) -> str:
    """Return the label with a uniform separator, since decoders mark drop-frame differently."""
    return label.replace(";", ":")
