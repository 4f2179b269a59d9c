"""A process that stands by forks successors of those that die."""

import json
import signal
import subprocess
import time

import captures
import pytest

from panoptic_ros.io.rigs import write_rig
from panoptic_ros.running.processes.children import ForkServer, Processes, child_environment

pytest.importorskip("rclpy")


def until(condition, seconds=60.0):
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def is_ready(server):
    server.code_of(0)
    return server.ready


@pytest.fixture
def launch(tmp_path):
    write_rig(tmp_path / "rig.json", captures.RIG)
    path = tmp_path / "launch.json"
    path.write_text(json.dumps({"rig": str(tmp_path / "rig.json"), "processes": {"idle": []}}))
    return path


def test_successors_are_forked_and_their_end_is_known(launch, tmp_path):
    server = ForkServer(launch, tmp_path / "server.log", child_environment())
    try:
        assert server.fork("idle", tmp_path / "early.log") is None  # it is not ready: the slow way
        until(lambda: is_ready(server))
        child, other = (server.fork("idle", tmp_path / f"{k}.log") for k in range(2))
        assert child.poll() is None and child.pid != other.pid
        child.kill()
        assert child.wait(20.0) == -signal.SIGKILL
        with pytest.raises(subprocess.TimeoutExpired):
            other.wait(0.1)
        other.send_signal(signal.SIGINT)
        assert other.wait(20.0) == 0
        faulty = server.fork("unknown", tmp_path / "faulty.log")
        assert faulty.wait(20.0) == 1 and "KeyError" in (tmp_path / "faulty.log").read_text()
    finally:
        server.close()


def test_what_is_killed_is_revived_by_a_fork_and_ends_with_the_rest(launch, tmp_path):
    with Processes(launch, ["idle"], tmp_path / "logs", revived=True) as running:
        until(lambda: is_ready(running._server))
        running.kill("idle")
        assert running.revive() == ["process idle was killed (signal 9) and is restarted"]
        (pid,) = running.ids
        running.check()
    assert running._children["idle"].poll() is not None
    until(lambda: not _lives(pid))


def _lives(pid):
    try:
        with open(f"/proc/{pid}/stat") as file:
            return file.read().rpartition(")")[2].split()[0] not in "ZX"
    except FileNotFoundError:
        return False
