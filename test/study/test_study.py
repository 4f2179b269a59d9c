"""Every study runs from end to end on its smallest case; the runner, the tables and the error bars."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from panoptic_ros.cli.main import main
from panoptic_ros.errors import UsageError
from panoptic_ros.io.files import known
from panoptic_ros.running.simulations.body_scenes import body_scene
from panoptic_ros.study.bodies import alignment, cases, devices, times
from panoptic_ros.study.names import STUDIES, parsed, study_of
from panoptic_ros.study.people import identity_study
from panoptic_ros.study.study import (
    Case,
    Column,
    Study,
    averaged,
    mean_and_width,
    run_study,
    table,
)

SMALLEST = {  # options of the smallest case
    "ablation": "--scenes three-views-2p --seeds 3 --frames 4 --only lag",
    "alignment": "--scenes body-walk --seeds 1",
    "captures": "--scenes body-leaves --seeds 1",
    "clocks": "--minutes 0.2 --only midnight",
    "devices": "--scenes body-walk --seeds 1",
    "identity": "--trials 1",
    "kinematics": "--scenes body-walk --seeds 1",
    "kinematics-inputs": "--scenes body-walk --cameras 1",
    "kinematics-time": "--seconds 2",
    "ltc": "--clips 1 --words 60 --only inverted --no-libltc",
    "ltc-impairments": "--number 1",
    "ltc-sounds": "--seconds 2",
    "ltc-starts": "--number 2",
    "offsets": "--cases one-walker --seeds 0 --frames 30",
    "patches": "--views 3 --frames 20",
    "solve": "--scenes three-views-2p --frames 4",
    "sound": "--cases talker --microphones 2 --seeds 3 --seconds 12",
    "stage1": "--people 1 --views 3 --many-views 0 --skeletons panoptic15 --frames 2 --budget 0.01",
    "start": "--runs 1",
    "visibility": "--frames 1",
    "walkout": "--seeds 1",
}
ELSEWHERE = {  # run by other tests, or they need models, a graph, a capture or root
    "rig": {"cameras", "nodes", "time", "resolution"},
    "a capture": {"detection", "fill", "live", "offsets-shifted", "refine", "refine-faults", "steady"},
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
    """Captures of bodies and of designated people that last four seconds; short visits."""
    for module in (cases, devices, times):
        monkeypatch.setattr(module, "body_scene", lambda name: replace(body_scene(name), seconds=4.0))
    monkeypatch.setattr(alignment, "WINDOWS_S", (0.5,))
    monkeypatch.setattr(identity_study, "DESIGNATED_S", 4.0)
    monkeypatch.setattr(identity_study, "VISITS_S", 300.0)


@pytest.mark.parametrize("name", SMALLEST)
def test_a_study_runs_on_its_smallest_case(name):
    told = []
    study = parsed(name, SMALLEST[name].split())
    result = run_study(study, lambda share, doing: told.append(share))
    assert result["study"] == name and result["rows"]
    assert told == sorted(told) and told[-1] == 1.0
    json.dumps(known(result), allow_nan=False)
    lines = list(study.lines(result))
    assert len(lines) >= 1 and all(isinstance(line, str) and "\n" not in line for line in lines)


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
