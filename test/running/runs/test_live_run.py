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
from panoptic_ros.errors import EnvironmentProblem
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
