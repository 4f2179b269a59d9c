"""How well a decoder reads timecode: recall, wrong labels, and errors of the starts against the truth.

Pure: decoders are functions, signals carry their truth. So one table can hold several decoders, also ones
from outside.
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
    """What a decoder says.

    Args:
        label: HH:MM:SS:FF, drop-frame or not.
        start_sample: of the first edge of bit 0, fractional.
        std_samples: its standard deviation, nan if the decoder has none.
    """

    label: str
    start_sample: float
    std_samples: float = float("nan")


Decoder = Callable[[Array, int], Iterable[DecodedWord]]  # samples (N,) float32 and their rate


@dataclass(frozen=True, slots=True)
class TimecodeRow:
    """Scores of one condition; times in microseconds, nan where nothing was read.

    Args:
        words: sent.
        right: read with the right label within half a word.
        wrong: reported with another label, or where there is no word.
        twice: reported again.
        bias_us, std_us: mean and standard deviation of the errors of the starts.
        consistency: root mean square of errors over stated deviations; 1 = honest.
        scatter: the same without what the errors of each signal have in common.
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
        """Share of the words that were read."""
        return self.right / self.words


def timecode_table(
    decoder: Decoder, conditions: Iterable[tuple[str, Sequence[TimedSignal]]]
) -> list[TimecodeRow]:
    """One row per condition, over all its signals.

    Args:
        conditions: names and signals, which may be made as they are asked for.

    Raises:
        DataError: if a condition has no words.
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
    """Errors and deviations in samples of the right words; how many were wrong, how many came twice."""
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
    """Decoders differ in how they mark drop-frame."""
    return label.replace(";", ":")
