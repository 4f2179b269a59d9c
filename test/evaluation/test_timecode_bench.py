"""Scores of timecode decoders that are wrong in known ways."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pytest

from panoptic_ros.domain import Timecode
from panoptic_ros.errors import DataError
from panoptic_ros.evaluation.timecode_bench import DecodedWord, timecode_table
from panoptic_ros.simulation.ltc_signal import LtcSignal, encode_ltc, timecode_rate

RATE = 48000


@pytest.fixture
def signal() -> LtcSignal:
    return encode_ltc(Timecode.from_frame_count(1800, timecode_rate("29.97df")), 10, RATE, lead=100.0)


def truth(signal: LtcSignal) -> list[DecodedWord]:
    return [DecodedWord(str(t), float(s), 0.048) for t, s in zip(signal.labels, signal.starts)]


def test_a_perfect_decoder(signal: LtcSignal) -> None:
    (row,) = timecode_table(lambda samples, rate: truth(signal), [("clean", [signal, signal])])
    assert (row.words, row.right, row.wrong, row.twice, row.recall) == (20, 20, 0, 0, 1.0)
    assert row.bias_us == row.std_us == row.consistency == 0.0


def test_every_mistake_is_counted(signal: LtcSignal) -> None:
    words = truth(signal)

    def decoder(samples: np.ndarray, rate: int) -> Iterable[DecodedWord]:
        assert samples is signal.samples and rate == RATE
        moved = [DecodedWord(w.label.replace(";", ":"), w.start_sample + 0.096, 0.048) for w in words[:6]]
        mislabelled = DecodedWord(words[7].label, words[6].start_sample)
        nowhere = DecodedWord(words[9].label, 1e6)
        return [*moved, moved[2], mislabelled, nowhere]

    (row,) = timecode_table(decoder, [("bad", [signal])])
    assert (row.right, row.wrong, row.twice) == (6, 2, 1)
    assert row.recall == pytest.approx(0.6)
    assert row.bias_us == pytest.approx(2.0) and row.std_us == pytest.approx(0.0, abs=1e-6)
    assert row.consistency == pytest.approx(2.0)


def test_silence_has_no_errors_and_no_words_are_refused(signal: LtcSignal) -> None:
    rows = timecode_table(lambda samples, rate: [], [("deaf", [signal])])
    assert rows[0].recall == 0.0 and np.isnan(rows[0].std_us)
    with pytest.raises(DataError, match="'empty' has no words"):
        timecode_table(lambda samples, rate: [], [("empty", [])])
