"""Clocks that are named for their timecode: lines between them by the samples of whoever hears them."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from panoptic_ros.clocks.config import ClocksConfig
from panoptic_ros.clocks.stage import ClocksStage, behind, inverse
from panoptic_ros.domain import ClockModel, Timecode, TimecodeReading
from panoptic_ros.simulation.ltc_signal import timecode_rate

SECOND = 10**9
RATES = {"A": timecode_rate("25"), "B": timecode_rate("29.97"), "C": timecode_rate("24")}
FIRST = {"A": 900_000, "B": 1_080_090, "C": 48}
SPEED = {"A": 1.0, "B": 1 + 38e-6, "C": 1 - 12e-6}
BEGIN = {"A": 0.0, "B": 0.3, "C": 0.11}  # true s of the first label


def label_s(clock, true_s):
    """What a clock shows."""
    return Fraction(FIRST[clock]) / RATES[clock].exact + Fraction((true_s - BEGIN[clock]) * SPEED[clock])


def readings(
    clock, recorder="tc", seconds=10.0, crystal=1 + 80e-6, noise=0.0, late=None, skip=lambda s: 0, jump=None
):
    """Words of a clock at a recorder of 48 kHz, whose first sample is at 0 s.

    Args:
        late: by true s: how much later than its instant a word is stamped, ns.
        skip: by true s: samples that were lost and not counted. jump: (true s, frames) of the labels.
    """
    rng = np.random.default_rng(ord(clock))
    rate, found = RATES[clock].exact, []
    for k in range(int((seconds - BEGIN[clock]) * rate)):
        true_s = BEGIN[clock] + float(k / rate) / SPEED[clock]
        sample = 48_000 * true_s * crystal - skip(true_s) + noise * rng.standard_normal()
        ahead = jump[1] if jump and true_s >= jump[0] else 0
        label = Timecode.from_frame_count(FIRST[clock] + k + ahead, RATES[clock])
        stamp = round(SECOND * (5.0 + true_s)) + (late(true_s) if late else 0)
        found.append((true_s, TimecodeReading(recorder, stamp, label, sample, 0.01, False, 0, clock, 48_000)))
    return found


def heard(*streams, stage=None, until=1e9):
    """Models by clock, the newest last, and notices, of readings in the order of time."""
    stage = stage or ClocksStage(ClocksConfig(master_clock="A"))
    models, notices = {}, []
    for true_s, reading in sorted((row for stream in streams for row in stream), key=lambda row: row[0]):
        if true_s < until:
            result = stage.step(reading)
            notices += result.notices
            for model in result.outputs:
                models.setdefault(model.device, []).append((true_s, model))
    return models, notices


def error_ns(model, clock, true_s, ahead_s=Fraction(0)):
    """Of the master time that a model gives to what a clock shows at a true time."""
    shown = round((label_s(clock, true_s) + ahead_s) * SECOND)
    return float(model.master_from_device(shown)[0] - label_s("A", true_s) * SECOND)


def test_two_timecodes_in_one_recording():
    models, notices = heard(readings("A"), readings("B"))
    assert not notices
    for true_s, model in models["B"]:
        assert abs(error_ns(model, "B", true_s)) < 20 and model.segment == 0
        assert model.from_ns <= round(label_s("B", true_s) * SECOND) + 1
    last = models["B"][-1][1]
    assert last.drift == pytest.approx(1 / SPEED["B"] - 1, abs=1e-10)
    assert {model.offset_ns for _, model in models["A"]} == {0}  # the master's time is its own


def test_stamps_do_not_matter_to_clocks_with_timecode_and_tell_of_the_clock_of_the_recorder():
    rng = np.random.default_rng(3)
    delays = {}

    def late(true_s):
        return delays.setdefault(round(true_s, 2), int(1e6 * rng.exponential(4.0)))

    models, _ = heard(readings("A", late=late), readings("B", late=late))
    assert max(abs(error_ns(model, "B", s)) for s, model in models["B"]) < 20
    at, model = models["tc"][-1]
    found = model.master_from_device(round(SECOND * (5.0 + at)))[0]
    assert abs(float(found - label_s("A", at) * SECOND)) < 1e6  # from below: not by the 4 ms of the mean


def test_recorders_that_share_a_clock_connect_the_others():
    models, _ = heard(
        readings("A"),
        readings("B"),
        readings("B", "far", crystal=1 - 50e-6),
        readings("C", "far", crystal=1 - 50e-6),
    )
    assert max(abs(error_ns(model, "C", s)) for s, model in models["C"]) < 30
    assert {"A", "B", "C", "tc", "far"} == set(models)


def test_a_clock_that_nothing_connects_to_the_master_has_no_model():
    models, _ = heard(readings("A"), readings("B", "far"))
    assert "B" not in models and "A" in models


def test_lost_sound_moves_both_and_is_never_a_step_between_them():
    def skip(true_s):
        return 2400 * (true_s > 5.0)

    models, notices = heard(readings("A", skip=skip), readings("B", skip=skip))
    assert max(abs(error_ns(model, "B", s)) for s, model in models["B"]) < 20
    assert {model.segment for _, model in models["B"]} == {0}
    assert {notice.code for notice in notices} == {"clocks.jump"}


@pytest.mark.parametrize("frames", [300, -450])
def test_a_timecode_that_is_set_anew_has_another_line_from_there_on(frames):
    models, notices = heard(readings("A"), readings("B", jump=(5.0, frames)))
    assert "clocks.timecode_jump" in {notice.code for notice in notices}
    ahead = frames / RATES["B"].exact
    for s, model in models["B"]:
        if model.segment == 0:
            assert s < 5.6 and abs(error_ns(model, "B", s)) < 20
        else:
            assert abs(error_ns(model, "B", s, ahead)) < 20
            assert model.from_ns >= round((label_s("B", 5.0) + ahead) * SECOND) - SECOND // 2
    assert models["B"][-1][1].segment == 1


def test_master_time_runs_on_where_its_timecode_is_set_anew():
    models, _ = heard(readings("A", jump=(5.0, 250)), readings("B"))
    assert max(abs(error_ns(model, "B", s)) for s, model in models["B"]) < 20
    at, model = models["A"][-1]
    assert abs(error_ns(model, "A", at, Fraction(10))) < 20 and model.segment == 1


def test_over_midnight(monkeypatch):
    monkeypatch.setitem(FIRST, "A", 24 * 3600 * 25 - 125)
    models, notices = heard(readings("A"), readings("B"))
    assert not notices
    assert max(abs(error_ns(model, "B", s)) for s, model in models["B"]) < 20


@pytest.mark.parametrize("rate", [44_100, 52_200])
def test_sound_of_another_rate_than_it_says_is_told_and_gives_no_wrong_time(rate):
    crystal = rate / 48_000
    models, notices = heard(readings("A", crystal=crystal), readings("B", crystal=crystal))
    assert [n.code for n in notices] == ["clocks.timecode_rate"]
    assert f"has about {rate:.0f} Hz instead of the stated 48000 Hz" in notices[0].text
    assert "B" not in models  # 29.97 or 30, who knows


def test_a_rate_that_may_be_another_is_not_used_at_once(monkeypatch):
    monkeypatch.setitem(SPEED, "B", 1 - 900e-6)  # a slow 29.97, or 30 that is far too slow
    models, notices = heard(readings("A"), readings("B"))
    assert min(s for s, _ in models["B"]) > 3.0
    assert [n.code for n in notices] == ["clocks.timecode_rate"] and "B runs -980 ppm" in notices[0].text


def test_state_in_the_middle_goes_on_alike():
    rows = sorted(readings("A") + readings("B", jump=(5.0, 300)), key=lambda row: row[0])
    config = ClocksConfig(master_clock="A")
    whole, cut = ClocksStage(config), ClocksStage(config)
    for k, (_, reading) in enumerate(rows):
        if k % 40 == 17:
            cut, state = ClocksStage(config), cut.state()
            cut.begin(state)
        assert repr(whole.step(reading)) == repr(cut.step(reading))


def test_lines_behind_each_other_and_back():
    rng = np.random.default_rng(0)
    for _ in range(50):
        lines = [
            ClockModel(
                "x",
                int(rng.integers(1, 10**14)),
                int(rng.integers(1, 10**13)),
                rng.normal(0, 1e-4),
                np.diag([1e-12, 1e-16]),
                rng.uniform(-0.5, 0.5),
                0,
                10**14,
            )
            for _ in range(2)
        ]
        at = int(rng.integers(1, 10**14))
        y = lines[0].master_from_device(at)[0]
        assert abs(inverse(lines[0], "y").master_from_device(y)[0] - at) <= 2
        assert abs(behind(*lines).master_from_device(at)[0] - lines[1].master_from_device(y)[0]) <= 2
        variance = behind(*lines).covariance - lines[0].covariance
        since = (lines[0].master_from_device(lines[0].reference_ns)[0] - lines[1].reference_ns) * 1e-9
        assert variance[0, 0] == pytest.approx(1e-12 + since**2 * 1e-16)


def test_channels_that_are_exchanged_on_the_way_move_no_clock():
    def swapped(clock):
        other = {"A": "B", "B": "A"}[clock]
        rows = [row for row in readings(clock, seconds=20.0) if row[0] < 8.0]
        return rows + [(s, replace(r, clock=clock)) for s, r in readings(other, seconds=20.0) if s >= 8.0]

    models, notices = heard(swapped("A"), swapped("B"))
    told = [n for n in notices if n.code == "clocks.other_timecode"]
    assert [n.severity for n in told] == ["warning"] * 2
    assert "timecode of B at tc had 30 frames per second, and has 25 now: are channels swapped" in (
        told[0].text + told[1].text
    )
    assert max(true_s for true_s, _ in models["B"]) < 8.2
    assert all(abs(error_ns(model, "B", true_s)) < 1000 for true_s, model in models["B"])
    assert abs(error_ns(models["B"][-1][1], "B", 20.0)) < 1000  # held over


@pytest.fixture
def alike(monkeypatch):
    """Two generators of one frame rate, 7 s apart."""
    monkeypatch.setitem(RATES, "B", RATES["A"])
    monkeypatch.setitem(FIRST, "B", FIRST["A"] + 175)


def test_channels_of_one_rate_that_are_exchanged_on_the_way_move_no_clock(alike):
    def swapped(clock):
        other = {"A": "B", "B": "A"}[clock]
        rows = [row for row in readings(clock, seconds=20.0) if not 8.0 <= row[0] < 14.0]
        return rows + [(s, replace(r, clock=clock)) for s, r in readings(other, seconds=14.0) if s >= 8.0]

    models, notices = heard(swapped("A"), swapped("B"))
    assert [n.code for n in notices] == ["clocks.other_timecode"] * 2  # told once, no jump
    assert "continues that of" in notices[0].text and "are channels swapped" in notices[0].text
    assert not any(8.2 < true_s < 14.0 for true_s, _ in models["B"])
    assert max(true_s for true_s, _ in models["B"]) > 19.0  # they came back
    assert all(abs(error_ns(model, "B", true_s)) < 1000 for true_s, model in models["B"])
    assert {model.segment for _, model in models["B"]} == {0}


def test_a_generator_that_is_set_to_the_time_of_another_has_jumped(alike):
    def jam(clock):
        rows = readings(clock, seconds=20.0)
        if clock == "A":
            return rows
        other = dict((round(s, 2), r) for s, r in readings("A", seconds=20.0))
        synced = [(s, replace(r, clock="B")) for s, r in other.items() if s >= 8.0]
        return [row for row in rows if row[0] < 8.0] + synced

    _, notices = heard(jam("A"), jam("B"))
    assert "clocks.other_timecode" not in [n.code for n in notices]
    assert any(n.code in ("clocks.timecode_jump", "clocks.jump") for n in notices)
