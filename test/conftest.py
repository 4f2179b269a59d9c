"""What all tests share: builders in test/support, and settings that disturb nobody."""

import os
import sys
import tempfile
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, settings

sys.path.insert(0, str(Path(__file__).parent / "support"))
os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
os.environ.setdefault("ROS_DOMAIN_ID", str(20 + os.getpid() % 80))  # a domain of one's own
if "PYTEST_XDIST_WORKER" in os.environ:  # gw0, gw1, ...: and one for each of several processes
    worker = int(os.environ["PYTEST_XDIST_WORKER"].removeprefix("gw"))
    os.environ["ROS_DOMAIN_ID"] = str((int(os.environ["ROS_DOMAIN_ID"]) + 1 + worker) % 102)
os.environ.setdefault("OMP_NUM_THREADS", "1")
STATE = tempfile.TemporaryDirectory()  # takes that tests leave open are not named to the user
os.environ["XDG_STATE_HOME"] = STATE.name

# Time is not what these tests assert: a kernel's first call compiles it. On a machine that decides about a
# change, the examples are the same every time.
settings.register_profile(
    "panoptic",
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow],
    derandomize=bool(os.environ.get("CI")),
)
settings.load_profile("panoptic")


@pytest.hookimpl(optionalhook=True)  # of pytest-xdist
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Where several processes test: one of them has all graphs, the others have the rest file by file.

    Two live graphs at once would starve one another, and fixtures of a file are made once. Marks of groups
    (`xdist_group`) would do the same, but pytest 9.2 ignores what pytest-xdist 3.8 makes of them.
    """
    from xdist.scheduler import LoadScopeScheduling

    class ByFile(LoadScopeScheduling):
        def _split_scope(self, nodeid: str) -> str:
            file = nodeid.split("::")[0]
            return "graphs" if file in graphs else file

    graphs = {
        path.relative_to(config.rootpath).as_posix()
        for path in Path(__file__).parent.rglob("test_*.py")
        if "pytest.mark.ros" in path.read_text()
    }
    return ByFile(config, log)
