"""Every executable ends with exit code 0 on SIGINT and on SIGTERM, and says in one line what it lacks."""

import signal
import subprocess
import sys
import time

import captures
import pytest

from panoptic_ros.io.rigs import write_rig

pytest.importorskip("rclpy")
pytestmark = pytest.mark.ros


SAYS_WHEN_UP = """import rclpy
init = rclpy.init
def say_when_up(*arguments, **options):
    init(*arguments, **options)
    print("up", flush=True)
rclpy.init = say_when_up
"""


def start(name, *parameters):
    arguments = [word for text in parameters for word in ("-p", text)]
    code = f"import sys; sys.argv = ['{name}', '--ros-args', *{arguments!r}]\n" if arguments else ""
    code += SAYS_WHEN_UP + f"from panoptic_ros.nodes import main\nmain.{name}()"
    return subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )


def wait_until_up(child):
    """Signals that come while modules are imported end any Python program as they like."""
    for line in child.stdout:
        if line.strip() == "up":
            break
    assert child.poll() is None, child.communicate()[0]


def check_ends(child, *sent, after_s):
    wait_until_up(child)
    time.sleep(after_s)
    for one in sent:
        child.send_signal(one)
        time.sleep(0.02)
    said, _ = child.communicate(timeout=20)
    assert child.returncode == 0 and not said, said


@pytest.mark.parametrize("sent", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
@pytest.mark.parametrize("name", ["sync", "refinement", "markers"])
def test_ends_cleanly(name, sent):
    check_ends(start(name), sent, after_s=1.0)


@pytest.mark.parametrize("after_s", [0.0, 0.02, 0.05, 0.1])
def test_ends_cleanly_while_it_is_made(after_s):
    check_ends(start("refinement"), signal.SIGINT, after_s=after_s)


def test_signals_that_come_twice_end_it_once():
    """A terminal signals its whole group, and launchers pass the signal on."""
    check_ends(start("sync"), signal.SIGINT, signal.SIGINT, after_s=1.0)


def test_rig_publisher_ends_cleanly(tmp_path):
    write_rig(tmp_path / "rig.json", captures.RIG)
    child = start("rig", f"rig:={tmp_path / 'rig.json'}", "skeleton:=panoptic19")
    check_ends(child, signal.SIGINT, after_s=1.0)


@pytest.mark.parametrize(
    ("name", "parameters", "told"),
    [
        ("rig", (), "parameter `rig`"),
        ("camera", (), "`video` or `device`"),
        ("sync", ("window_s:=9.0",), "window_s"),
    ],
)
def test_says_in_one_line_what_is_wrong(name, parameters, told):
    child = start(name, *parameters)
    said, _ = child.communicate(timeout=30)
    assert child.returncode == 2, said
    lines = [line for line in said.splitlines() if line.startswith("panoptic: ")]
    assert len(lines) == 1 and told in lines[0] and "Traceback" not in said
