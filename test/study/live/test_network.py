"""Figures of the network bench, and hosts on one machine where those can be had."""

import os
import subprocess

import pytest

from panoptic_ros.errors import EnvironmentProblem
from panoptic_ros.study.live.network import figures
from panoptic_ros.study.live.network_hosts import two_hosts


def test_what_is_lost_late_and_silent():
    """Ten messages a second of two cameras; of one, two are lost and two come half a second late."""
    came = []
    for k in range(100):
        sent = 0.05 + 0.1 * k
        came.append(["left", k, 0.010, sent + 0.010])
        if k not in (40, 41):
            late = 0.5 if k in (70, 71) else 0.010
            came.append(["right", k, late, sent + late])
    found = figures(came, 2.0, 8.0)
    assert (found["sent"], found["lost"]) == (120, 2)
    assert found["p50_ms"] == pytest.approx(10.0) and found["p99_ms"] > 400.0
    assert found["silence_s"] == pytest.approx(0.3)


def test_hosts_lose_packets_on_demand_and_leave_nothing_behind():
    try:
        with two_hosts() as hosts:
            names = subprocess.run(["ip", "netns", "list"], capture_output=True, text=True, check=True).stdout
            assert names.count(f"panoptic-{os.getpid()}-") == 2
            hosts.lose(0.05)
            hosts.lose(0.0)
            process = hosts.start(1, ["ip", "-4", "addr", "show", "eth0"], os.environ)
            assert process.wait(20.0) == 0
    except EnvironmentProblem as error:
        pytest.skip(f"NO HOSTS ON THIS MACHINE: {error}")
    names = subprocess.run(["ip", "netns", "list"], capture_output=True, text=True, check=True).stdout
    assert f"panoptic-{os.getpid()}-" not in names
