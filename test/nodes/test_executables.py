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
    time.sleep(1.0)
    assert child.poll() is None, child.communicate()[0]


@pytest.mark.parametrize("sent", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("name", ["sync", "refinement", "markers"])
def test_ends_cleanly(name, sent):
    child = start(name)
    wait_until_up(child)
    child.send_signal(sent)
    said, _ = child.communicate(timeout=20)
    assert child.returncode == 0, said
    assert "Traceback" not in said


def test_rig_publisher_ends_cleanly(tmp_path):
    write_rig(tmp_path / "rig.json", captures.RIG)
    child = start("rig", f"rig:={tmp_path / 'rig.json'}", "skeleton:=panoptic19")
    wait_until_up(child)
    child.send_signal(signal.SIGINT)
    said, _ = child.communicate(timeout=20)
    assert child.returncode == 0 and "Traceback" not in said, said


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
