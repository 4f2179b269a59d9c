"""The timecode of a whole recording: the beginning of each signal uses what was learnt later.

Words are read as in a stream. Then the first ones of each signal are timed anew with the shape of edges and
the speed that the following words have taught, and all words of a signal get the rate that its last word has.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from panoptic_ros.domain import TimecodeReading
from panoptic_ros.errors import DataError
from panoptic_ros.timecode.config import TimecodeConfig
from panoptic_ros.timecode.decoder import LtcDecoder
from panoptic_ros.timecode.follow.pace import Pace, std_of
from panoptic_ros.timecode.follow.reading import Word
from panoptic_ros.timecode.follow.wander import Wander
from panoptic_ros.timecode.label.rates import with_rate
from panoptic_ros.timecode.signal.wave import Samples
from panoptic_ros.timecode.word.fit import WordFit, fit_free_edges, fit_word

Array = np.ndarray
EARLY_WORDS = 90  # are timed again; after them the shape was known well enough
LINE_WORDS = 12  # from which the speed at the beginning is found
PASSES = 2
PIECE_SECONDS = 1.0


def decode_recording(
    config: TimecodeConfig, device: str, sample_rate: int, samples: Array, stamp_ns: int = 0
) -> list[TimecodeReading]:
    """Decode a whole recording.

    Args:
        samples: (N,) of one channel, the first at `stamp_ns`.

    Returns: all readings, in the order of the recording.

    Raises:
        DataError: samples are not finite.
    """
    if not np.isfinite(samples).all():
        raise DataError(f"audio of {device} has samples that are not finite")
    decoder = LtcDecoder(config, sample_rate)
    piece = int(PIECE_SECONDS * sample_rate)
    words: list[Word] = []
    for first in range(0, len(samples), piece):
        words += decoder.push(samples[first : first + piece])
    words += decoder.finish()
    readings = []
    for signal in _signals(words):
        rate = signal[-1].timecode.rate
        early = _timed_anew(signal[:EARLY_WORDS], samples, sample_rate)
        for word in [*early, *signal[EARLY_WORDS:]]:
            stamp = max(0, stamp_ns + round(word.start / sample_rate * 1e9))
            label = with_rate(word.timecode, rate)
            readings.append(
                TimecodeReading(device, stamp, label, word.start, word.std, word.reverse, word.user_bits)
            )
    return readings


def _signals(words: list[Word]) -> Iterator[list[Word]]:
    """Words that were followed from one to the next."""
    signal: list[Word] = []
    for word in words:
        if signal and word.shape is not signal[-1].shape:
            yield signal
            signal = []
        signal.append(word)
    if signal:
        yield signal


def _timed_anew(words: list[Word], samples: Array, sample_rate: int) -> list[Word]:
    """The words with starts by all that is known at the end of their signal."""
    fits = [_fit(word, samples, sample_rate) if word.ticks is None else None for word in words]
    pace = Pace(words[0].reverse)
    line = None
    good = [(word, fit) for word, fit in zip(words, fits) if fit is not None]
    if len(good) >= LINE_WORDS:
        for word, there in good[:LINE_WORDS]:
            pace.take(word.number, there, None)
        line = pace.line
    pace = Pace(words[0].reverse, line)
    out = []
    for word, found in zip(words, fits):
        taken = None if found is None else pace.take(word.number, found, None)
        out.append(word if taken is None else replace(word, start=taken[0], std=taken[1]))
    return _tracked_anew(out, samples, sample_rate)


def _tracked_anew(words: list[Word], samples: Array, sample_rate: int) -> list[Word]:
    """The same for words in which the speed changes; the first pass learns how fast it does."""
    tracked = [word for word in words if word.ticks is not None]
    if not tracked:
        return words
    wander = Wander(words[0].reverse, 0.0, 0.0)
    anew: dict[int, Word] = {}
    for _ in range(PASSES):
        wander = wander.again_at(wander)
        for word in tracked:
            assert word.ticks is not None
            before = wander.before(word.number, word.ticks)
            own = wander.own(word.ticks)
            part = _part(word, samples)
            fit = fit_free_edges(part, word.bits, own, sample_rate, word.shape, before) if word.sure else None
            if fit is not None:
                start, variance = wander.take(word.number, fit, word.ticks)
                anew[word.number] = replace(word, start=start, std=std_of(variance))
    return [anew.get(word.number, word) if word.ticks is not None else word for word in words]


def _fit(word: Word, samples: Array, sample_rate: int) -> WordFit | None:
    """The fit of a word that nothing contradicts."""
    if not word.sure:
        return None
    return fit_word(_part(word, samples), word.bits, word.grid, sample_rate, word.shape)


def _part(word: Word, samples: Array) -> Samples:
    """The samples about a word."""
    first = max(0, int(word.grid.middle - 45.0 * word.grid.cell))
    last = int(word.grid.middle + 45.0 * word.grid.cell)
    return Samples(first, samples[first:last].astype(np.float64))
