"""Every module imports lower ranks only, and the checker catches every planted violation."""

import os
import subprocess
import sys
from pathlib import Path

import layers
import pytest

import panoptic_ros

ROOT = Path(panoptic_ros.__file__).parent
STANDARD = frozenset(sys.stdlib_module_names)
MODULES = layers.modules(ROOT)


def test_no_module_breaks_the_ranks():
    found = [
        line
        for name, path in MODULES.items()
        if name != "panoptic_ros"
        for line in layers.violations(name, path.read_text(), STANDARD)
    ]
    assert found == []


def test_every_room_has_a_rank_and_every_rank_a_room():
    rooms = {p.stem for p in ROOT.iterdir() if p.suffix == ".py" and p.stem != "__init__"}
    rooms |= {p.name for p in ROOT.iterdir() if p.is_dir() and any(p.glob("*.py"))}
    assert rooms == set(layers.RANKS)


@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("panoptic_ros.geometry.x", "import panoptic_ros.domain"),
        ("panoptic_ros.voting.x", "from panoptic_ros.assembly import config"),
        ("panoptic_ros.voting.x", "from panoptic_ros import io"),
        ("panoptic_ros.voting.x", "def f():\n    from panoptic_ros.nodes import main"),
        ("panoptic_ros.voting.x", "from ..assembly import config"),
        ("panoptic_ros.tracking.x", "import rclpy"),
        ("panoptic_ros.graph.x", "from panoptic_ros.io.bags import BagReader"),
        ("panoptic_ros.io.x", "from panoptic_ros.capture import open_files"),
        ("panoptic_ros.view.x", "from panoptic_ros.nodes import main"),
        ("panoptic_ros.nodes.x", "from panoptic_ros.running.processes.children import Processes"),
        ("panoptic_ros.running.x", "from panoptic_ros.cli.options import number"),
        ("panoptic_ros.running.x", "from panoptic_ros.nodes.listeners.collector_node import CollectorNode"),
        ("panoptic_ros.running.x", "import rclpy"),
        ("panoptic_ros.running.x", "print(1)"),
        ("panoptic_ros.cli.x", "import numpy as np"),
        ("panoptic_ros.cli.x", "from panoptic_ros.graph.pipeline import Pipeline"),
        ("panoptic_ros.cli.x", "def f():\n    from panoptic_ros.voting import VotingConfig"),
        ("panoptic_ros.cli.x", "x = 1\n" * (layers.LONGEST_VERB + 1)),
        ("panoptic_ros.timecode.signal.x", "from panoptic_ros.timecode.word.edges import fit_edges"),
        ("panoptic_ros.timecode.label.x", "from panoptic_ros.timecode import decoder"),
        ("panoptic_ros.timecode.word.x", "from ..follow import wander"),
        ("panoptic_ros.kinematics.pose.x", "from panoptic_ros.kinematics.imus.mounting import Mounting"),
        ("panoptic_ros.nodes.middleware.x", "from panoptic_ros.nodes.stages.inputs import Inputs"),
        ("panoptic_ros.timecode.config", "import panoptic_ros.timecode.stage"),
        ("panoptic_ros.voting.x", "import time"),
        ("panoptic_ros.voting.x", "import os"),
        ("panoptic_ros.voting.x", "print(1)"),
        ("panoptic_ros.voting.x", "open('a')"),
        ("panoptic_ros.voting.x", "import numpy as np\nnp.random.normal()"),
        ("panoptic_ros.voting.x", "import numpy as np\nnp.random.default_rng()"),
        ("panoptic_ros.voting.x", "import matplotlib"),
        ("panoptic_ros.voting.x", "from numba import njit"),
        ("panoptic_ros.attic.x", "import math"),
    ],
)
def test_planted_violation_is_caught(module, source):
    assert layers.violations(module, source, STANDARD)


@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("panoptic_ros.voting.x", "from panoptic_ros.domain import Rig\nimport numpy as np\nimport math"),
        ("panoptic_ros.voting.x", "from panoptic_ros.voting.config import VotingConfig"),
        ("panoptic_ros.timecode.label.x", "from panoptic_ros.timecode.word.layout import SYNC"),
        ("panoptic_ros.timecode.label.x", "from panoptic_ros.timecode.label import counting"),
        ("panoptic_ros.timecode.decoder", "from panoptic_ros.timecode.follow import lock"),
        ("panoptic_ros.voting.x", "import numpy as np\nnp.random.default_rng(3).normal()"),
        ("panoptic_ros.capture.x", "from panoptic_ros.io.rigs import read_rig"),
        ("panoptic_ros.cli.x", "import time\nprint(time.time())"),
        ("panoptic_ros.cli.x", "import panoptic_ros.running.runs.run\n" * layers.LONGEST_VERB),
    ],
)
def test_what_is_allowed_passes(module, source):
    assert layers.violations(module, source, STANDARD) == []


def test_all_but_nodes_import_without_ros():
    """In a fresh process with rclpy blocked: a laptop without ROS can solve and evaluate."""
    names = [n for n in MODULES if layers.room_of(n) != "nodes" and n not in layers.NEED_ROS]
    code = (
        "import sys, importlib\n"
        "sys.modules['rclpy'] = None\n"
        f"for name in {names!r}:\n"
        "    if not name.endswith('__main__'): importlib.import_module(name)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr[-2000:]


def test_one_module_alone_imports_matplotlib():
    """It loads whatever MPLBACKEND says; `view.plotting` tells why."""
    found = [
        name
        for name, path in MODULES.items()
        if any(word in path.read_text() for word in ("from matplotlib", "import matplotlib", "mpl_toolkits"))
    ]
    assert found == ["panoptic_ros.view.plotting"]


@pytest.mark.parametrize("backend", ["no_such", "module://matplotlib_inline.backend_inline"])
def test_plots_load_with_any_backend_of_a_terminal(backend):
    code = "import os, panoptic_ros.view.plot3d; print(os.environ['MPLBACKEND'])"
    variables = {**os.environ, "MPLBACKEND": backend}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=variables)
    assert (done.returncode, done.stdout) == (0, f"{backend}\n"), done.stderr
