"""Processes of a launcher that die: told, or started anew."""

import json
import re
import sys
import time
from xml.etree import ElementTree

import pytest

from panoptic_ros.errors import ContractError, EnvironmentProblem, UserError
from panoptic_ros.running.processes import children as module
from panoptic_ros.running.processes.children import MOST_REVIVALS, LaunchPreparation, Processes


@pytest.fixture
def launched(tmp_path, monkeypatch):
    """Processes that run a text of Python in place of nodes."""

    def start(text):
        child = tmp_path / "child.py"
        child.write_text(text)
        real = module.subprocess.Popen
        monkeypatch.setattr(
            module.subprocess, "Popen", lambda words, **more: real([sys.executable, str(child)], **more)
        )
        (tmp_path / "launch.json").write_text(json.dumps({}))
        return Processes(tmp_path / "launch.json", ["fusion"], tmp_path / "logs")

    return start


@pytest.fixture
def told(tmp_path, monkeypatch):
    """A process that prints what it is told, in place of nodes, and where processes of a launch print."""
    child = tmp_path / "ahead.py"
    child.write_text(
        "import json, pathlib, sys; words = json.loads(sys.stdin.readline()); "
        "pathlib.Path(words[-1]).write_text(f'panoptic: {words[1]}'); raise SystemExit(2)"
    )
    monkeypatch.setattr(module, "HOST", (sys.executable, str(child)))
    return child


def test_the_first_process_may_have_been_loaded_ahead(told, tmp_path):
    launch, logs = tmp_path / "launch.json", tmp_path / "logs"
    with LaunchPreparation() as ahead, Processes(launch, ["fusion"], logs, ahead=ahead) as running:
        with pytest.raises(UserError, match="^fusion$"):
            until(running.check)


def test_what_broke_down_ahead_is_started_anew_and_tells_why(told, tmp_path):
    told.write_text("print('it is broken'); raise SystemExit(1)")
    with LaunchPreparation() as ahead:
        ahead._process.wait()
        with Processes(tmp_path / "l.json", ["fusion"], tmp_path / "logs", ahead=ahead) as running:
            with pytest.raises(ContractError, match="it is broken"):
                until(running.check)


def test_what_nobody_needed_ahead_is_ended(told):
    with LaunchPreparation() as ahead:
        process = ahead._process
        assert process.poll() is None
    assert process.returncode == -9


def until(condition, seconds=20.0):
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def test_what_was_killed_is_started_anew_and_told(launched):
    with launched("import time; time.sleep(60)") as running:
        assert running.names == ("fusion",) and running.revive() == []
        (before,) = running.ids
        running.kill("fusion")
        assert running.revive() == ["process fusion was killed (signal 9) and is restarted"]
        (after,) = running.ids
        assert after != before and running.revive() == []
        running.kill("fusion")
        with pytest.raises(EnvironmentProblem, match="fusion was killed"):
            running.check()


def test_what_breaks_down_time_and_again_ends_the_run(launched):
    told = []

    def revive():
        told.extend(running.revive())
        return False

    with launched("print('it is broken'); raise SystemExit(1)") as running:
        with pytest.raises(ContractError, match="fusion ended with exit code 1: .*it is broken"):
            until(revive)
    assert told == ["process fusion broke down (exit code 1) and is restarted"] * MOST_REVIVALS


def test_what_the_user_can_mend_is_not_started_anew(launched):
    with launched("print('panoptic: no such camera'); raise SystemExit(2)") as running:
        with pytest.raises(UserError, match="no such camera"):
            until(lambda: running.revive() != [])


@pytest.mark.parametrize(
    ("name", "field", "larger"),
    [(module.LISTENER, "segment_size", False), (module.LOCAL, "maxMessageSize", True)],
)
def test_profiles_differ_in_one_thing_alone(name, field, larger):
    full, other = (
        ElementTree.canonicalize(module.profile_path(each).read_text(), strip_text=True)
        for each in (module.SENDER, name)
    )
    held = re.compile(f"<{field}>([0-9]+)</{field}>")
    assert held.sub("", full) == held.sub("", other) != full
    before, after = (sum(map(int, held.findall(text))) for text in (full, other))
    assert (after > before) == larger


@pytest.mark.parametrize(
    ("reach", "name"),
    [(None, module.LOCAL), ("LOCALHOST", module.LOCAL), ("SUBNET", module.SENDER)],
)
def test_messages_are_cut_into_datagrams_only_where_a_network_may_lose_them(monkeypatch, reach, name):
    monkeypatch.setattr(module.os, "environ", {} if reach is None else {module.RANGE: reach})
    module.prepare_environment()
    assert module.os.environ[module.PROFILE].endswith(f"/{name}")
