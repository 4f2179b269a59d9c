"""No dependency reports to its maker: telemetry is off before a library loads, in every process."""

import ast
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import panoptic_ros

ROOT = Path(panoptic_ros.__file__).parent
TEST = Path(__file__).parent.parent
SWITCH = "ORT_DISABLE_TELEMETRY"
# onnxruntime itself stays silent under these and in its unit tests, which would hide a missing switch
CI = (
    "TF_BUILD",
    "GITHUB_ACTIONS",
    "GITLAB_CI",
    "CIRCLECI",
    "TRAVIS",
    "JENKINS_URL",
    "CODEBUILD_BUILD_ID",
    "BUILDKITE",
    "TEAMCITY_VERSION",
    "APPVEYOR",
    "BITBUCKET_BUILD_NUMBER",
    "ORT_RUNNING_UNIT_TESTS",
    "CI",
)
BY_NAME = ("import_module", "__import__")  # calls that import a module by its name
RUN_A_MODEL = """
import numpy as np
from blobs import Blobs
from panoptic_ros.detection.backends.choice import open_network
network = open_network(Blobs.heads_card(), Blobs.heads_network())
network.run(np.zeros((1, 64, 96, 3), np.uint8))
"""


def environment(home: Path, **given: str) -> dict[str, str]:
    """The environment of a child with a home of its own, without what would hide a missing switch."""
    left_out = {SWITCH, "XDG_CACHE_HOME", *CI}
    kept = {name: value for name, value in os.environ.items() if name not in left_out}
    return {**kept, "HOME": str(home), "PYTHONPATH": str(TEST / "support"), **given}


def python(code: str, home: Path, *before: str, **given: str) -> str:
    """Run code in a child process; returns its standard output."""
    command = [*before, sys.executable, "-c", code]
    done = subprocess.run(command, env=environment(home, **given), capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    return done.stdout


def importers(library: str, folder: Path) -> set[str]:
    """The files below a folder that import a library by a statement or by its name in a string."""
    texts = {path: path.read_text() for path in folder.rglob("*.py")}
    found = (path for path, text in texts.items() if library in text and library in imported(text))
    return {path.relative_to(folder).as_posix() for path in found}


def imported(source: str) -> set[str]:
    """The first parts of the names that a module imports."""
    names: list[object] = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            names.append(node.module)
        elif isinstance(node, ast.Call) and ast.unparse(node.func).endswith(BY_NAME):
            names += [given.value for given in node.args if isinstance(given, ast.Constant)]
    return {str(name).split(".")[0] for name in names}


@pytest.mark.parametrize("library, owner", [("onnxruntime", "onnx"), ("openvino", "openvino")])
def test_one_module_imports_a_library_that_has_telemetry(library, owner):
    assert importers(library, ROOT) == {f"detection/backends/{owner}.py"}
    assert importers(library, TEST) == set()


@pytest.mark.parametrize(
    "source", ["import onnxruntime.x", "from onnxruntime import x", "importlib.import_module('onnxruntime')"]
)
def test_the_search_for_imports_finds_each_kind(source, tmp_path):
    (tmp_path / "other.py").write_text(source)
    assert importers("onnxruntime", tmp_path) == {"other.py"}


def test_the_package_sets_the_switch_and_keeps_what_the_user_has_set(tmp_path):
    code = f"import panoptic_ros, os; print(os.environ['{SWITCH}'])"
    assert python(code, tmp_path).strip() == "1"
    assert python(code, tmp_path, **{SWITCH: "0"}).strip() == "0"


def test_the_switch_is_set_when_the_importing_module_runs():
    """The package runs before its modules; the ROS executables, children and tests begin with one of them."""
    assert os.environ[SWITCH]
    source = (ROOT / "__init__.py").read_text()
    calls = [ast.unparse(node) for node in ast.parse(source).body if isinstance(node, ast.Expr)]
    assert f"os.environ.setdefault('{SWITCH}', '1')" in calls


def test_a_model_leaves_no_file_behind_and_opens_no_socket(tmp_path):
    """With telemetry, the import of onnxruntime makes a device identifier and a database in the cache."""
    home = tmp_path / "home"
    home.mkdir()
    trace = tmp_path / "trace"
    python(RUN_A_MODEL, home, *_traced(trace))
    assert [path for path in home.rglob("*") if path.is_file()] == []
    if trace.exists():
        assert [line for line in trace.read_text().splitlines() if "socket(" in line] == []


def _traced(trace: Path) -> list[str]:
    """The words that run a command in an empty network namespace with its sockets written to a file.

    Returns: an empty list where strace or the right to make a namespace is missing.
    """
    if not (shutil.which("strace") and shutil.which("unshare")):
        return []
    words = ["unshare", "-n", "strace", "-f", "-e", "trace=%network", "-o", str(trace)]
    works = subprocess.run([*words, "true"], capture_output=True).returncode == 0
    return words if works else []
