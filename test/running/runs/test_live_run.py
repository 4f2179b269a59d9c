"""A live run ends when it is asked to, or when a camera fails, and keeps what it has."""

import json
import os
import signal
from dataclasses import replace

import captures
import pytest
from recordings import write_bag

from panoptic_ros.cli.main import main
from panoptic_ros.cli.run import source
from panoptic_ros.cli.run.watch import TerminalObserver
from panoptic_ros.errors import EnvironmentProblem
from panoptic_ros.io import bag_recorder
from panoptic_ros.io.bags import BagReader
from panoptic_ros.io.plain_formats import read_skeletons
from panoptic_ros.io.takes import OPEN
from panoptic_ros.running.runs import run as running_run
from panoptic_ros.running.runs.in_process import run_in_process


@pytest.fixture
def run_live(tmp_path, monkeypatch, capsys):
    """Run a bag as if cameras gave it until `end(stop)`; gives exit code, what is left, what is said."""
    bag = write_bag(tmp_path / "bag", captures.views(6))
    plan_of = source.make_plan
    monkeypatch.setattr(source, "make_plan", lambda args: replace(plan_of(args), live=True))

    def run(end, frames=True):
        def record(plan, results, stop, *how):
            if frames:
                run_in_process(replace(plan, live=False), results, stop)
            end(stop)
            return {}

        monkeypatch.setattr(running_run, "_over_dds", record)
        code = main(["run", "--bag", str(bag), "--out", str(tmp_path / "out"), "--no-pictures"])
        return code, sorted(path.name for path in tmp_path.iterdir()), capsys.readouterr().err

    return run


def ask(stop):
    assert not stop()
    os.kill(os.getpid(), signal.SIGINT)
    assert stop()


def fail(stop):
    raise EnvironmentProblem("camera a was lost")


def test_asked_to_end_it_writes_what_it_has(run_live, tmp_path):
    assert run_live(ask)[:2] == (0, ["bag", "out"])
    assert json.loads((tmp_path / "out" / "report.json").read_text())["frames"]["out"] == 6


def test_asked_to_end_before_there_is_anything_it_leaves_nothing(run_live):
    assert run_live(ask, frames=False) == (2, ["bag"], "panoptic run: interrupted\n")


def test_a_fault_is_told_after_what_there_was_is_written(run_live):
    code, left, said = run_live(fail)
    assert code == 2 and left == ["bag", "out"] and said.endswith("panoptic run: camera a was lost\n")
    assert run_live(fail, frames=False)[0] == 2


@pytest.mark.parametrize("error", [ValueError("odd"), KeyError("cam9"), BrokenPipeError(), MemoryError()])
def test_a_bug_ends_the_take_and_keeps_it(run_live, tmp_path, error):
    def break_down(stop):
        raise error

    code, left, said = run_live(break_down)
    assert code == 1 and left == ["bag", "out"] and "broke down" in said and "Traceback" not in said
    assert json.loads((tmp_path / "out" / "report.json").read_text())["frames"]["out"] == 6
    assert not (tmp_path / "out" / OPEN).exists()


def test_an_error_of_the_display_ends_the_display(run_live, tmp_path, monkeypatch):
    def saw(self, key, record):
        raise RuntimeError("no window")

    monkeypatch.setattr(TerminalObserver, "saw", saw)
    code, _, said = run_live(ask)
    assert code == 0 and said.count("the display ended (RuntimeError: no window)") == 1
    assert json.loads((tmp_path / "out" / "report.json").read_text())["frames"]["out"] == 6


@pytest.mark.parametrize("error", [ValueError("odd"), KeyboardInterrupt()])
def test_an_error_of_the_report_costs_the_report(run_live, tmp_path, monkeypatch, error):
    def fail_to_report(*about, **more):
        raise error

    monkeypatch.setattr(running_run, "finish", fail_to_report)
    code, left, said = run_live(ask)
    assert code == 0 and left == ["bag", "out"] and "the take is whole" in said
    with BagReader(tmp_path / "out" / "bag") as reader:
        assert reader.counts["/skeletons"] == 6
    assert len(read_skeletons(tmp_path / "out" / "skeletons.json.gz").frames) == 6


def test_messages_for_which_the_disk_was_too_slow_are_reported(run_live, tmp_path, monkeypatch):
    monkeypatch.setattr(bag_recorder, "MOST_WAITING", 0)
    assert run_live(ask)[0] == 0
    dropped = json.loads((tmp_path / "out" / "report.json").read_text())["frames"]["dropped"]
    assert dropped["take: disk_too_slow"] >= 6


def test_a_take_without_any_record_for_its_whole_duration_says_so(run_live, tmp_path):
    assert run_live(lambda stop: None, frames=False)[0] == 0
    assert json.loads((tmp_path / "out" / "report.json").read_text())["frames"]["out"] == 0
