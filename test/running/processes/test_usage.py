"""Processor time and memory of processes."""

import os
import subprocess
import sys

import pytest

from panoptic_ros.errors import EnvironmentProblem
from panoptic_ros.running.processes.usage import usage_of


def test_of_this_process_it_is_what_python_knows():
    before = usage_of([os.getpid()])
    times = os.times()
    after = usage_of([os.getpid()])
    tick = 1.0 / os.sysconf("SC_CLK_TCK")
    assert before.cpu_s - 2 * tick <= times.user + times.system <= after.cpu_s + 2 * tick
    assert before.at_ns < after.at_ns and after.resident_mb > 5.0


def test_several_processes_are_added_up():
    command = [sys.executable, "-c", "print('here', flush=True); input()"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as child:
        assert child.stdout is not None
        assert child.stdout.readline() == b"here\n"  # a process that only begins has no memory yet
        alone, both = usage_of([os.getpid()]), usage_of([os.getpid(), child.pid])
        child.communicate(b"\n")
    assert both.resident_mb > alone.resident_mb and both.cpu_s >= alone.cpu_s


def test_one_that_is_gone_is_told():
    child = subprocess.Popen([sys.executable, "-c", ""])
    child.wait()
    with pytest.raises(
        EnvironmentProblem, match=f"/proc/{child.pid}/stat, the file of processor times, cannot be read"
    ):
        usage_of([child.pid])
