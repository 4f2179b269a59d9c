"""Every executable ends with exit code 0 on SIGINT and on SIGTERM, and says in one line what it lacks."""

import signal
import subprocess
import sys
import time

import captures
import executable
import pytest
from fork_server import ForkServer

from panoptic_ros.io.rigs import write_rig

pytest.importorskip("rclpy")
pytestmark = pytest.mark.ros


@pytest.fixture(scope="module")
def server():
    """A process with all modules, of which executables are forked."""
    with ForkServer("executable") as server:
        yield server


@pytest.fixture
def start(server, tmp_path):
    """Starts an executable; in a process that is forked, or apart in one that begins from nothing."""

    def start(name, *parameters, apart=False):
        words = [name, *(["--ros-args"] if parameters else [])]
        words += [word for text in parameters for word in ("-p", text)]
        said = tmp_path / "said"
        said.touch()
        if not apart:
            return server.start(*words, output=said), said
        with said.open("w") as output:
            command = [sys.executable, executable.__file__, *words]
            return subprocess.Popen(command, stdout=output, stderr=output), said

    return start


def wait_until_up(child, said):
    """Signals that come while modules are imported end any Python program as they like."""
    while child.poll() is None and "up" not in said.read_text().splitlines():
        time.sleep(0.002)
    assert child.poll() is None, said.read_text()


def check_ends(started, *sent, after_s):
    child, said = started
    wait_until_up(child, said)
    time.sleep(after_s)
    for one in sent:
        child.send_signal(one)
        time.sleep(0.02)
    code, lines = child.wait(), said.read_text().splitlines()
    assert code == 0 and not lines[lines.index("up") + 1 :], lines


@pytest.mark.parametrize("sent", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
@pytest.mark.parametrize("name", ["sync", "refinement", "markers"])
def test_ends_cleanly(start, name, sent):
    check_ends(start(name), sent, after_s=1.0)


@pytest.mark.parametrize("after_s", [0.0, 0.02, 0.05, 0.1])
def test_ends_cleanly_while_it_is_made(start, after_s):
    check_ends(start("refinement"), signal.SIGINT, after_s=after_s)


def test_signals_that_come_twice_end_it_once(start):
    """A terminal signals its whole group, and launchers pass the signal on."""
    check_ends(start("sync", apart=True), signal.SIGINT, signal.SIGINT, after_s=1.0)


def test_rig_publisher_ends_cleanly(start, tmp_path):
    write_rig(tmp_path / "rig.json", captures.RIG)
    started = start("rig", f"rig:={tmp_path / 'rig.json'}", "skeleton:=panoptic19")
    check_ends(started, signal.SIGINT, after_s=1.0)


@pytest.mark.parametrize(
    ("name", "parameters", "told"),
    [
        ("rig", (), "parameter `rig`"),
        ("camera", (), "`video` or `device`"),
        ("sync", ("window_s:=9.0",), "window_s"),
    ],
)
def test_says_in_one_line_what_is_wrong(start, name, parameters, told):
    child, file = start(name, *parameters)
    assert child.wait() == 2, file.read_text()
    said = file.read_text()
    lines = [line for line in said.splitlines() if line.startswith("panoptic: ")]
    assert len(lines) == 1 and told in lines[0] and "Traceback" not in said
