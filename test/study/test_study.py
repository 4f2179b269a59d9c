"""Every study runs from end to end on its smallest case; the runner, the tables and the error bars."""

import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from study_runs import in_this_process, run_whole

from panoptic_ros.cli.main import main
from panoptic_ros.errors import UsageError
from panoptic_ros.running.simulations.body_scenes import body_scene
from panoptic_ros.study.bodies import alignment, captures, cases, devices
from panoptic_ros.study.names import STUDIES, parsed, study_of
from panoptic_ros.study.study import (
    Case,
    Column,
    Study,
    averaged,
    mean_and_width,
    run_study,
    table,
)
from panoptic_ros.study.timing import clocks

SMALLEST = {  # options of the smallest case
    "ablation": "--scenes three-views-2p --seeds 3 --frames 4 --only lag",
    "alignment": "--scenes body-walk --seeds 1",
    "calibration": "--cases 4x60 --seeds 0",
    "calibration-pattern": "--cases 24 --seeds 0",
    "calibration-people": "--cases 4 --seeds 1 --seconds 2",
    "camera-health": "--cases 5x1 --events none --quiet-s 1 --seeds 0",
    "captures": "--scenes body-leaves --seeds 1",
    "clocks": "--minutes 0.2 --only midnight",
    "continuous": "--cases free --seeds 1 --seconds 2",
    "continuous-time": "--seconds 2 --times 2",
    "devices": "--scenes body-walk --seeds 1",
    "kinematics": "--scenes body-walk --seeds 1",
    "kinematics-inputs": "--scenes body-walk --cameras 1",
    "ltc": "--clips 1 --words 60 --only inverted --no-libltc",
    "ltc-impairments": "--number 1",
    "ltc-sounds": "--seconds 2",
    "ltc-starts": "--number 2",
    "offsets": "--cases one-walker --seeds 0 --frames 30",
    "patches": "--views 3 --frames 20",
    "solve": "--scenes three-views-2p --frames 4",
    "sound": "--cases talker --microphones 2 --seeds 3 --seconds 12",
    "start": "--runs 1",
    "visibility": "--frames 1",
}
ELSEWHERE = {  # run by other tests, or they need models, a graph, a capture or root
    "whole, beside the truth": {"identity", "kinematics-time", "stage1", "walkout"},
    "rig": {"cameras", "nodes", "time", "resolution"},
    "a capture": {
        "calibration-sessions",
        "detection",
        "fill",
        "live",
        "offsets-shifted",
        "refine",
        "refine-faults",
        "steady",
    },
    "a model": {"borders", "child"},
    "a live graph": {"graph", "kinematics-live", "recording", "soak", "view", "view-recording"},
    "root": {"network"},
    "minutes": {"accidents", "faults", "sound-motion", "terms"},
}


def test_all_studies_have_a_class_and_a_case_that_is_run():
    assert set(SMALLEST) | set().union(*ELSEWHERE.values()) == set(STUDIES)
    assert list(STUDIES) == sorted(STUDIES)
    for name, (_, about) in STUDIES.items():
        assert (issubclass(study_of(name), Study) and about[0] != about[0].upper().lower().upper()) or about


@pytest.fixture(autouse=True)
def short_captures(monkeypatch):
    """Captures of bodies that last seconds, of which the first is not scored; clocks that act early."""
    for module in (cases, captures):
        monkeypatch.setattr(module, "SKIPPED_S", 1.0)
    for module, seconds in ((cases, 2.0), (devices, 4.0)):
        monkeypatch.setattr(module, "body_scene", partial(short_scene, seconds))
    monkeypatch.setattr(devices, "SLIPS_S", 1.0)
    monkeypatch.setattr(devices, "TOLD_S", 2.0)
    monkeypatch.setattr(clocks, "events", partial(clocks.events, 11.0, 5))
    monkeypatch.setattr(clocks, "audio_error_s", partial(clocks.audio_error_s, 6.0))


def short_scene(seconds, name):
    return replace(body_scene(name), seconds=seconds)


@pytest.mark.parametrize("name", SMALLEST)
def test_a_study_runs_on_its_smallest_case(name, monkeypatch):
    """In this process, where compiled code is loaded already: others run studies in processes of theirs."""
    study = parsed(name, SMALLEST[name].split())
    in_this_process(monkeypatch, study)
    if name == "alignment":  # motion tells only after the T-pose
        monkeypatch.setattr(cases, "body_scene", partial(short_scene, 4.0))
        monkeypatch.setattr(alignment, "WINDOWS_S", (0.5,))
    assert run_whole(study)["rows"]


class Squares(Study):
    """Squares of numbers, for tests."""

    columns = (Column("word", "word"), Column("number", "number"), Column("square_m", "mm", ".1f", 1e3))
    over = ("word",)

    def cases(self):
        """Two cases, the second three times as long."""
        return [Case("one", (1.0, 2.0), 1.0), Case("two", (3.0,), 3.0)]

    def measure(self, case, progress):
        """A row for each number."""
        for k, number in enumerate(case.request):
            progress(k / len(case.request), "squares")
            yield {"word": case.title, "number": number, "square_m": number**2}

    def summary(self, rows):
        """The sum."""
        return {"sum": sum(row["square_m"] for row in rows)}


def test_the_runner_measures_all_cases_in_order_and_shares_progress_by_cost():
    told = []
    result = run_study(Squares("squares", None), lambda share, doing: told.append((share, doing)))
    assert [row["square_m"] for row in result["rows"]] == [1.0, 4.0, 9.0] and result["sum"] == 14.0
    assert (0.25, "two: squares") in told and told[-1][0] == 1.0


def test_rows_are_averaged_with_error_bars():
    rows = run_study(Squares("squares", None))["rows"]
    one, two = averaged(rows, ("word",))
    assert one["square_m"] == pytest.approx((2.5, 12.706 * 1.5), rel=1e-3)  # Student's t of 1: 12.706
    assert two["square_m"][0] == 9.0 and math.isnan(two["square_m"][1]) and one["samples"] == 2
    assert mean_and_width([None, math.nan, 3.0])[0] == 3.0 and math.isnan(mean_and_width([])[0])
    text = list(Squares("squares", None).lines({"rows": rows}))
    assert text[1].split() == ["one", "1.5", "±6.353", "2500.0", "±19059.3"]
    rows = [{"word": "a", "gap": None}, {"word": "a", "gap": 2.0}, {"word": "a", "gap": np.float32(4.0)}]
    (row,) = averaged(rows, ("word",))  # not known in the first
    assert row["gap"][0] == 3.0 and Column("gap", "", ".1f").cell({"gap": np.float32("nan")}) == "-"


def test_tables_align_and_stand_across():
    columns = (Column("name", "name"), Column("share", "share", ".1%"), Column("count", "count"))
    rows = [{"name": "first", "share": 0.5, "count": 3}, {"name": "b", "share": math.nan, "count": None}]
    assert table(rows, columns) == ["name   share  count", "first  50.0%      3", "b          -      -"]
    assert table(rows, columns, across=True) == ["name   first  b", "share  50.0%  -", "count      3  -"]


def test_studies_are_listed_and_mistakes_are_told_in_one_line(capsys):
    assert main(["study"]) == 0
    listed = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in listed] == list(STUDIES)
    for arguments, told in (
        (["study", "solv"], "the nearest known one is 'solve'"),
        (["study", "solve", "--volume", "3"], "unrecognized arguments: --volume 3"),
        (["study", "solve", "--plot", "x.png"], "unrecognized arguments: --plot"),
        (["study", "solve", "--json", "/"], "cannot write /: it is a folder"),
    ):
        assert main(arguments) == 2
        error = capsys.readouterr().err.strip()
        assert told in error and "\n" not in error
    with pytest.raises(UsageError, match="'7:3': write FROM:TO"):
        parsed("solve", ["--seeds", "7:3"])
