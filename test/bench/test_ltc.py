"""The timecode bench measures what it says."""

from __future__ import annotations

import argparse
import json

import numpy as np
import pytest

from panoptic_ros.bench import ltc
from panoptic_ros.bench.libltc import load_libltc
from panoptic_ros.bench.ltc_conditions import CONDITIONS, Condition, clip, noise_bound_us
from panoptic_ros.bench.ltc_sounds import KINDS, sounds


def arguments(*more: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    ltc.add_arguments(parser)
    return parser.parse_args(list(more))


def test_one_row_and_its_table() -> None:
    result = json.loads(json.dumps(ltc.measure(arguments("--quick", "--only", "noise +20"))))
    names = [row["condition"] for row in result["conditions"]]
    assert names == ["48 kHz, noise +20 dB", "16 kHz, noise +20 dB"]
    for row in result["conditions"]:
        assert row["recall"] == 1.0 and row["wrong"] == 0 and row["twice"] == 0
        assert row["std_us"] < 3.0 * row["bound_us"]
        assert row["start_s"] < 0.5 and row["latency_s"] < 0.2
    head, *rows = ltc.lines(result)
    assert head.split()[:5] == ["condition", "words", "recall", "wrong", "twice"]
    assert "100.00" in rows[0]


def test_without_libltc_it_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    result = ltc.measure(arguments("--quick", "--only", "inverted", "--no-libltc"))
    assert not result["libltc"] and "libltc11" in ltc.lines(result)[-1]


@pytest.mark.skipif(load_libltc() is None, reason="libltc is not installed")
def test_libltc_reads_a_clean_clip() -> None:
    decoder = load_libltc()
    assert decoder is not None
    signal = clip(Condition("clean", 48000, {"snr_db": 60.0}, rate="25"), 1, 30)
    labels = [word.label for word in decoder(signal.samples, 48000)]
    assert len(labels) >= 28 and set(labels) <= {str(label) for label in signal.labels}


def test_the_bound_follows_the_noise() -> None:
    bounds = [noise_bound_us(Condition("", 48000, {"snr_db": snr})) for snr in (30.0, 10.0)]
    assert bounds[1] / bounds[0] == pytest.approx(10.0)
    assert bounds[0] == pytest.approx(0.049, rel=0.2)
    assert np.isnan(noise_bound_us(CONDITIONS[-1]))
    assert len({condition.name for condition in CONDITIONS}) == len(CONDITIONS)


def test_sounds_without_timecode() -> None:
    pieces = list(sounds(110.0, 16000, 1))
    assert [name for name, _ in pieces] == list(KINDS)
    assert sum(len(samples) for _, samples in pieces) == 110 * 16000
    assert all(np.abs(samples).max() == pytest.approx(0.3) for _, samples in pieces)
    result = ltc.measure(arguments("--false-codes", "4"))
    assert sum(row["seconds"] for row in result["false_codes"]) == 4.0
    assert "0 words read where there are none" in ltc.lines(result)[-1]


def test_starts_are_counted() -> None:
    result = ltc.measure(arguments("--starts", "8"))
    assert result["starts"] == {"starts": 8, "dead": 0, "wrong": 0}
    assert ltc.lines(result) == ["0 of 8 starts not decoded, 0 wrong labels"]


def test_impairments_are_counted_for_both_ways_of_decoding() -> None:
    result = json.loads(json.dumps(ltc.measure(arguments("--impairments", "2", "--seed", "1001"))))
    rows = result["impairments"]
    assert set(rows) == {"recorded", "live"}
    for row in rows.values():
        assert (row["clips"], row["exceptions"], row["unusable"], row["wrong"]) == (2, 0, 0, 0)
        assert 0 < row["right"] <= row["sent"] and row["findings"] == []
    assert ltc.lines(result)[0].split()[:3] == ["decoded", "as", "clips"]
