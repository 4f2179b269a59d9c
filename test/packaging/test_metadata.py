"""What setup.cfg, setup.py, package.xml and the build files of the messages say must agree."""

from __future__ import annotations

import ast
import configparser
import importlib
import re
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

import panoptic_ros
from panoptic_ros.graph.nodes import NODES
from panoptic_ros.graph.topics import TOPICS
from panoptic_ros.io.models.fetch import NODE_WHEEL

ROOT = Path(panoptic_ros.__file__).resolve().parent.parent
ROSDEP_KEYS = {"opencv-python-headless": "python3-opencv", "pyyaml": "python3-yaml"}
BY_PIP = ("av", "backports.zstd", "numba", "onnx", "onnxruntime", "rosbags", "websockets")  # of package.xml
ONLY_PYTHON_3_10 = "tomli"
# packages of message types that the code names and that need not be installed
DONE_WITHOUT = {"tf2_msgs", "audio_common_msgs", "hri_msgs", "vision_msgs", "rpt_msgs"}
DONE_WITHOUT |= {"ffmpeg_image_transport_msgs", "foxglove_msgs", "theora_image_transport"}


def _setup_cfg() -> configparser.ConfigParser:
    parser = configparser.ConfigParser()
    parser.read(ROOT / "setup.cfg")
    return parser


def _requirements() -> dict[str, str]:
    """Distribution -> version condition of the core."""
    lines = _setup_cfg()["options"]["install_requires"].split("\n")
    pairs = (re.match(r"([A-Za-z0-9_.-]+)(.*)", line.strip()) for line in lines if line.strip())
    return {match[1].lower(): match[2] for match in pairs if match}


def _package(folder: Path) -> ElementTree.Element:
    return ElementTree.parse(folder / "package.xml").getroot()


def _texts(package: ElementTree.Element, *tags: str) -> set[str]:
    return {item.text or "" for tag in tags for item in package.iter(tag)}


def _imports(folder: Path) -> set[str]:
    """First parts of all absolute imports below a folder, and of strings that name message types."""
    found = set()
    for path in folder.rglob("*.py"):
        for item in ast.walk(ast.parse(path.read_text())):
            if isinstance(item, ast.Import):
                found |= {alias.name.split(".")[0] for alias in item.names}
            elif isinstance(item, ast.ImportFrom) and item.level == 0 and item.module:
                found.add(item.module.split(".")[0])
            elif isinstance(item, ast.Constant) and isinstance(item.value, str):
                named = re.fullmatch(r"([a-z0-9_]+)/msg/\w+", item.value)
                found |= {named[1]} if named else set()
    return found


def _is_ros(module: str) -> bool:
    return module in ("rclpy", "launch", "launch_ros") or module.endswith(("_msgs", "_interfaces"))


def _constant(path: Path, name: str) -> tuple[str, ...]:
    for item in ast.parse(path.read_text()).body:
        if isinstance(item, ast.Assign) and getattr(item.targets[0], "id", "") == name:
            return tuple(ast.literal_eval(item.value))
    raise AssertionError(f"{path} defines no {name}")


@pytest.mark.parametrize(
    ("folder", "name", "build"),
    [(ROOT, "panoptic_ros", "ament_python"), (ROOT / "msg_defs", "panoptic_msgs", "ament_cmake")],
)
def test_package_xml_is_of_format_3_and_complete(folder: Path, name: str, build: str) -> None:
    package = _package(folder)
    assert package.get("format") == "3"
    assert package.findtext("name") == name
    assert package.findtext("license") == "Apache-2.0"
    assert package.findtext("export/build_type") == build
    assert package.findtext("description")
    maintainer = package.find("maintainer")
    assert maintainer is not None and maintainer.text
    assert re.fullmatch(r"[\w.+-]+@[\w-]+\.[a-z]{2,}", maintainer.get("email", ""))  # else colcon ignores all
    assert (folder / "resource" / name).is_file()


def test_versions_are_the_same_everywhere() -> None:
    ours = panoptic_ros.__version__
    assert _package(ROOT).findtext("version") == ours
    messages = _package(ROOT / "msg_defs").findtext("version")
    assert f'version = "{messages}"' in (ROOT / "msg_defs" / "pyproject.toml").read_text()


def test_the_ros_wheels_are_pinned_to_one_version_everywhere() -> None:
    pins = {name: version for name, version in _requirements().items() if name.startswith("ros-")}
    assert set(pins) == {"ros-jazzy-rclpy", "ros-jazzy-common-interfaces", "ros-jazzy-rmw-fastrtps-cpp"}
    assert all(version.startswith("==") for version in pins.values())
    named = re.findall(r'"(ros-[a-z-]+)(==[\d.]+)"', (ROOT / "msg_defs" / "pyproject.toml").read_text())
    assert sorted(named) == sorted(2 * list(pins.items()))  # to build with, and to run with


def test_every_import_is_a_declared_dependency() -> None:
    declared = set(_requirements())
    known = sys.stdlib_module_names | {"panoptic_ros", "tomllib", "compression", ONLY_PYTHON_3_10}
    known |= DONE_WITHOUT
    used = {module for module in _imports(ROOT / "panoptic_ros") if not _is_ros(module)} - known
    providers = packages_distributions()
    assert used
    for module in used:
        assert declared & {name.lower() for name in providers[module]}, f"{module} is in no requirement"


def test_package_xml_names_what_setup_cfg_requires() -> None:
    depends = _texts(_package(ROOT), "exec_depend", "depend")
    comment = re.search(r"for them: ([a-z. ]+) -->", (ROOT / "package.xml").read_text())
    assert comment is not None and tuple(comment[1].split()) == BY_PIP
    for name in _requirements():
        if name not in (*BY_PIP, ONLY_PYTHON_3_10) and not name.startswith("ros-"):
            assert ROSDEP_KEYS.get(name, f"python3-{name}") in depends


def test_package_xml_names_the_ros_packages_that_are_used() -> None:
    depends = _texts(_package(ROOT), "exec_depend", "depend")
    imported = _imports(ROOT / "panoptic_ros") | _imports(ROOT / "launch")
    used = {module for module in imported if _is_ros(module)}
    used |= {topic.message.split("/")[0] for topic in TOPICS.values()}
    assert used - depends - DONE_WITHOUT == set()


def test_message_dependencies_are_the_same_in_all_three_builds() -> None:
    folder = ROOT / "msg_defs"
    text = "\n".join(path.read_text() for path in folder.glob("???/*.???") if path.suffix in (".msg", ".srv"))
    used = set(re.findall(r"^([a-z_]+)/[A-Z]", text, re.MULTILINE))
    built = _texts(_package(folder), "depend")  # setup.py reads them there
    assert used <= built
    cmake = (folder / "CMakeLists.txt").read_text()
    listed = re.search(r"DEPENDENCIES ([a-z_ ]+)\)", cmake)
    assert listed is not None and set(listed[1].split()) == built
    assert built <= set(re.findall(r"find_package\((\w+) REQUIRED\)", cmake))


def test_every_message_of_the_graph_is_defined() -> None:
    own = {topic.message for topic in TOPICS.values() if topic.message.startswith("panoptic_msgs/")}
    defined = {f"panoptic_msgs/msg/{path.stem}" for path in (ROOT / "msg_defs" / "msg").glob("*.msg")}
    assert own and own <= defined


def test_executables_are_the_functions_of_the_nodes_module() -> None:
    module = ast.parse((ROOT / "panoptic_ros" / "nodes" / "main.py").read_text())
    functions = {
        item.name
        for item in module.body
        if isinstance(item, ast.FunctionDef) and not item.name.startswith("_") and not item.args.args
    }
    code = "import sys; sys.argv = ['setup.py', '--name']; import setup; print(*setup.EXECUTABLES)"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    told = done.stdout
    executables = told.splitlines()[-1].split()
    assert set(executables) == functions | set(NODES)
    pytest.importorskip("rclpy")
    main = importlib.import_module("panoptic_ros.nodes.main")
    assert all(callable(getattr(main, name)) for name in executables)
    with pytest.raises(AttributeError, match="no attribute 'sink'"):
        main.sink  # noqa: B018


def test_versions_have_the_bounds_that_the_code_needs():
    conditions = _requirements()
    assert "<" in conditions["rosbags"] and "<" in conditions["numba"]  # whose inner parts are used
    assert conditions["websockets"] == ">=15"  # Connection.state
    assert _setup_cfg()["options.extras_require"]["npm"].split() == [NODE_WHEEL]
