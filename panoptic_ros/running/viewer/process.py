"""Runs `panoptic view` in a child process."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from panoptic_ros.errors import EnvironmentProblem
from panoptic_ros.running.processes.children import PROFILE, child_environment

PATIENCE_S = 20.0  # s, timeout for the end of the process


@contextmanager
def viewer(arguments: Sequence[str]) -> Iterator[tuple[int, str]]:
    """Start the viewer; yield its process id and the address of its page.

    Raises:
        EnvironmentProblem: if it does not start.
    """
    command = [sys.executable, "-m", "panoptic_ros.cli.main", "view", "--no-browser", "--port", "0"]
    # the viewer sets its own Fast DDS profile
    environment = {name: value for name, value in child_environment().items() if name != PROFILE}
    child = subprocess.Popen([*command, *arguments], stdout=subprocess.PIPE, text=True, env=environment)
    assert child.stdout is not None
    try:
        line = child.stdout.readline()
        found = re.search(r"http://\S+", line)
        if found is None:
            raise EnvironmentProblem(f"the viewer did not start: {line.strip() or 'no output'}")
        yield child.pid, found[0]
    finally:
        child.terminate()
        try:
            child.wait(PATIENCE_S)
        except subprocess.TimeoutExpired:
            child.kill()
            child.wait()
        child.stdout.close()
