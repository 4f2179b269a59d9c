"""The launch file, with stand-ins for the launch system, which is not among the ROS wheels."""

from __future__ import annotations

import ast
import runpy
import sys
import types
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import panoptic_ros
from panoptic_ros.domain import Camera, Rig
from panoptic_ros.errors import UsageError
from panoptic_ros.geometry import Intrinsics, Rigid
from panoptic_ros.graph.nodes import NODES
from panoptic_ros.io.rigs import write_rig

ROOT = Path(panoptic_ros.__file__).resolve().parent.parent
FILE = ROOT / "launch" / "panoptic.launch.py"


class Recorded:
    """An action that keeps what it was made with."""

    def __init__(self, *values: Any, **options: Any):
        self.values, self.options = values, options


class Context:
    def __init__(self, **given: str):
        self.launch_configurations = given


@pytest.fixture
def launch_file(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """Names of the launch file, as if the launch system were there."""
    modules = {
        "launch": ("LaunchDescription",),
        "launch.actions": ("DeclareLaunchArgument", "OpaqueFunction", "SetEnvironmentVariable"),
        "launch_ros": (),
        "launch_ros.actions": ("Node",),
    }
    for name, classes in modules.items():
        module = types.ModuleType(name)
        for item in classes:
            setattr(module, item, type(item, (Recorded,), {}))
        monkeypatch.setitem(sys.modules, name, module)
    return runpy.run_path(str(FILE))


@pytest.fixture
def rig_file(tmp_path: Path) -> Path:
    matrix = np.array([[500.0, 0, 320], [0, 500, 240], [0, 0, 1]])
    lens = Intrinsics(matrix, np.zeros(5))
    cameras = tuple(
        Camera(name, (640, 480), lens, Rigid(np.eye(3), np.array([x, 0.0, 3.0])))
        for name, x in (("left", 0.0), ("right", 1.0))
    )
    write_rig(tmp_path / "rig.json", Rig(cameras))
    return tmp_path / "rig.json"


def _defaults(launch_file: dict[str, Any]) -> dict[str, str]:
    declared = launch_file["generate_launch_description"]().values[0]
    arguments = [item for item in declared if type(item).__name__ == "DeclareLaunchArgument"]
    return {item.values[0]: item.options["default_value"] for item in arguments}


def _nodes(launch_file: dict[str, Any], **given: str) -> dict[str, dict[str, Any]]:
    """Parameters of each node that is started, by name."""
    context = Context(**{**_defaults(launch_file), **given})
    started = launch_file["start_graph"](context)
    nodes = [item.options for item in started if type(item).__name__ == "Node"]
    assert all(item["package"] == "panoptic_ros" for item in nodes)
    return {item["name"]: {**item["parameters"][0], "executable": item["executable"]} for item in nodes}


def test_it_imports_nothing_that_a_jazzy_workspace_lacks() -> None:
    modules = {
        item.module.split(".")[0]
        for item in ast.walk(ast.parse(FILE.read_text()))
        if isinstance(item, ast.ImportFrom) and item.module
    }
    assert modules <= {"functools", "pathlib", "launch", "launch_ros", "panoptic_ros", "yaml"}


OFF = {"offsets", "kinematics", "flow", "patches", "appearance"}  # unless parameters say otherwise


def test_devices_start_every_stage_and_one_node_per_camera(
    launch_file: dict[str, Any], rig_file: Path
) -> None:
    devices = "left=/dev/video0 right=rtsp://host/stream?a=b"
    nodes = _nodes(launch_file, rig=str(rig_file), devices=devices, audio="recorder")
    around = {"rig", "markers", "camera_left", "camera_right", "timecode", "clocks", "detection"}
    assert set(nodes) == {*around, "fusion"}
    assert nodes["camera_right"]["device"] == "rtsp://host/stream?a=b"
    assert nodes["camera_right"]["camera"] == "right"
    assert nodes["fusion"]["cameras"] == ["left", "right"]
    assert nodes["detection"]["inputs.compressed_image"] == ["left", "right"]
    assert nodes["timecode"]["devices"] == ["recorder"]
    assert {item["flow"] for name, item in nodes.items() if name != "rig"} == {"live"}
    nodes = _nodes(launch_file, rig=str(rig_file), devices=devices, audio="recorder", node_per_stage="true")
    assert set(nodes) == {*around, *(set(NODES) - OFF)}


def test_every_executable_is_one_that_the_package_installs(
    launch_file: dict[str, Any], rig_file: Path
) -> None:
    nodes = _nodes(launch_file, rig=str(rig_file), devices="left=0")
    main = (ROOT / "panoptic_ros" / "nodes" / "main.py").read_text()
    own = {name for name in ("rig", "camera", "markers", "fusion") if f"\ndef {name}() -> None:" in main}
    assert {item["executable"] for item in nodes.values()} <= own | set(NODES)


def test_parameters_of_a_file_reach_their_stage(
    launch_file: dict[str, Any], rig_file: Path, tmp_path: Path
) -> None:
    (tmp_path / "parameters.yaml").write_text("tracking: {max_distance: 0.4}\n")
    config = str(tmp_path / "parameters.yaml")
    nodes = _nodes(launch_file, rig=str(rig_file), devices="left=0", config=config)
    assert nodes["fusion"]["tracking.max_distance"] == 0.4
    assert "tracking.max_distance" not in nodes["detection"]
    assert "timecode" not in nodes  # nobody named an audio device
    assert "offsets" not in nodes
    (tmp_path / "parameters.yaml").write_text("offsets: {active: true}\n")
    assert _nodes(launch_file, rig=str(rig_file), devices="left=0", config=config)["offsets"]["active"]


def test_a_capture_folder_is_replayed(launch_file: dict[str, Any], rig_file: Path) -> None:
    import cv2

    for camera in ("left", "right"):
        folder = rig_file.parent / camera
        folder.mkdir()
        assert cv2.imwrite(str(folder / "0.png"), np.zeros((480, 640, 3), np.uint8))
    nodes = _nodes(launch_file, capture=str(rig_file.parent))
    assert nodes["camera_left"]["video"] == str(rig_file.parent / "left")
    assert nodes["camera_left"]["rig"] == str(rig_file)
    assert nodes["detection"]["flow"] == "replay"


@pytest.mark.parametrize("text", ["true", "false"])
def test_nodes_are_started_anew_if_asked_for(launch_file: dict[str, Any], rig_file: Path, text: str) -> None:
    given = {**_defaults(launch_file), "rig": str(rig_file), "devices": "left=0 right=1", "respawn": text}
    started = launch_file["start_graph"](Context(**given))
    nodes = [item.options for item in started if type(item).__name__ == "Node"]
    assert {item["respawn"] for item in nodes} == {text == "true"}
    with pytest.raises(UsageError, match="respawn:=maybe"):
        _nodes(launch_file, rig=str(rig_file), devices="left=0", respawn="maybe")


@pytest.mark.parametrize(
    "given", [{}, {"capture": "a", "devices": "left=0"}, {"devices": "left=0"}, {"devices": "nobody=0"}]
)
def test_wrong_arguments_are_refused(
    launch_file: dict[str, Any], rig_file: Path, given: dict[str, str]
) -> None:
    rig = {"rig": str(rig_file)} if given.get("devices") == "nobody=0" else {}
    with pytest.raises(UsageError, match="devices"):
        _nodes(launch_file, **given, **rig)
