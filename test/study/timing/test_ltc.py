"""The timecode bench measures what it says."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from panoptic_ros.study.names import parsed
from panoptic_ros.study.study import run_study
from panoptic_ros.study.timing.libltc import load_libltc
from panoptic_ros.study.timing.ltc_conditions import CONDITIONS, Condition, clip, noise_bound_us
from panoptic_ros.study.timing.ltc_sounds import KINDS, sounds


def measured(name: str, *options: str) -> tuple[dict[str, Any], list[str]]:
    """Return the result and its lines."""
    study = parsed(name, options)
    result = json.loads(json.dumps(run_study(study)))
    return result, list(study.lines(result))


def test_one_row_and_its_table() -> None:
    few = ("--clips", "1", "--words", "90")
    result, (head, *rows) = measured("ltc", *few, "--only", "noise +20")
    names = [row["condition"] for row in result["rows"]]
    assert names == ["48 kHz, noise +20 dB", "16 kHz, noise +20 dB"]
    for row in result["rows"]:
        assert row["recall"] == 1.0 and row["wrong"] == 0 and row["twice"] == 0
        assert row["std_us"] < 3.0 * row["bound_us"]
        assert row["start_s"] < 0.5 and row["latency_s"] < 0.2
    assert head.split()[:5] == ["condition", "words", "recall", "%", "wrong"]
    assert "100.00" in rows[0]


def test_without_libltc_it_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    few = ("--clips", "1", "--words", "90", "--no-libltc")
    _, lines = measured("ltc", *few, "--only", "inverted")
    assert "libltc11" in lines[-1]


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
    result, lines = measured("ltc-sounds", "--seconds", "4")
    assert sum(row["seconds"] for row in result["rows"]) == 4.0
    assert "0 words read where there are none" in lines[-1]


def test_starts_are_counted() -> None:
    result, _ = measured("ltc-starts", "--number", "8")
    assert result["rows"] == [{"starts": 8, "dead": 0, "wrong": 0}]


def test_impairments_are_counted_for_both_ways_of_decoding() -> None:
    result, lines = measured("ltc-impairments", "--number", "2", "--seeds", "1001")
    assert [row["decoded"] for row in result["rows"]] == ["recorded", "live"]
    for row in result["rows"]:
        assert (row["clips"], row["exceptions"], row["unusable"], row["wrong"]) == (2, 0, 0, 0)
        assert 0 < row["right"] <= row["sent"] and row["findings"] == []
    assert lines[0].split()[:3] == ["decoded", "as", "clips"]
