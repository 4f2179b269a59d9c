"""Bars for scores."""

from __future__ import annotations

import pytest

from panoptic_ros.errors import UsageError
from panoptic_ros.evaluation import failures, parse_limit

SCORES = {"person_recall": 0.97, "pck": {"0.05": 0.9}, "median_mm": None, "nees": None}


def test_bars_that_are_met_and_missed():
    met = [parse_limit("person_recall=0.97"), parse_limit("pck.0.05=0.95", upper=True)]
    assert failures(SCORES, met) == []
    missed = [parse_limit("person_recall = 0.98"), parse_limit("pck.0.05=0.8", upper=True)]
    assert failures(SCORES, missed) == [
        "person_recall is 0.97, not at least 0.98",
        "pck.0.05 is 0.9, not at most 0.8",
    ]


def test_a_score_that_is_not_defined_misses_its_bar():
    limits = [parse_limit("median_mm=20", upper=True), parse_limit("nees.cover95=0.9")]
    assert len(failures(SCORES, limits)) == 2


@pytest.mark.parametrize("text", ["person_recall", "person_recall=high", "=", "recal=0.5", "pck.1=0.5"])
def test_bad_bars_are_named(text):
    with pytest.raises(UsageError):
        failures(SCORES, [parse_limit(text)])
