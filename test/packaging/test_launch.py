"""The launch file, with stand-ins for the launch system, which is not among the ROS wheels."""

from __future__ import annotations

import argparse
import ast
import json
import os
import runpy
import sys
import types
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import panoptic_ros
from panoptic_ros.cli.options import names
from panoptic_ros.cli.run import add_arguments
from panoptic_ros.cli.run.source import make_plan
from panoptic_ros.domain import Camera, Rig
from panoptic_ros.errors import UsageError
from panoptic_ros.geometry import Intrinsics, Rigid
from panoptic_ros.graph.nodes import NODES
from panoptic_ros.io.rigs import read_rig, write_rig
from panoptic_ros.running.processes.children import HOST
from panoptic_ros.running.runs.launch import flow_of, without_patch_inputs, write_launch_file

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
        "launch.actions": (
            "DeclareLaunchArgument",
            "ExecuteProcess",
            "OpaqueFunction",
            "SetEnvironmentVariable",
        ),
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


def pictures(folder: Path) -> None:
    """One image of each camera."""
    import cv2

    for camera in ("left", "right"):
        (folder / camera).mkdir()
        assert cv2.imwrite(str(folder / camera / "0.png"), np.zeros((480, 640, 3), np.uint8))


def _defaults(launch_file: dict[str, Any]) -> dict[str, str]:
    declared = launch_file["generate_launch_description"]().values[0]
    arguments = [item for item in declared if type(item).__name__ == "DeclareLaunchArgument"]
    return {item.values[0]: item.options["default_value"] for item in arguments}


def _started(launch_file: dict[str, Any], **given: str) -> list[Recorded]:
    context = Context(**{**_defaults(launch_file), **given})
    actions = launch_file["start_graph"](context)
    return [item for item in actions if type(item).__name__ in ("Node", "ExecuteProcess")]


def _document(started: list[Recorded]) -> dict[str, Any]:
    """The file of nodes and processes, which all processes read."""
    commands = [item.options["cmd"] for item in started if "cmd" in item.options]
    assert {tuple(words[: len(HOST)]) for words in commands} == {HOST}
    assert {words[-1] for words in commands} == {str(os.getpid())}
    (file,) = {words[-3] for words in commands}
    document: dict[str, Any] = json.loads(Path(file).read_text())
    assert [words[-2] for words in commands] == list(document["processes"])
    return document


def _nodes(launch_file: dict[str, Any], **given: str) -> dict[str, dict[str, Any]]:
    """The nodes that are started, by name."""
    processes = _document(_started(launch_file, **given))["processes"]
    return {node.get("name", node["kind"]): node for nodes in processes.values() for node in nodes}


def test_it_imports_nothing_that_a_jazzy_workspace_lacks() -> None:
    tree = list(ast.walk(ast.parse(FILE.read_text())))
    modules = {item.module.split(".")[0] for item in tree if isinstance(item, ast.ImportFrom) and item.module}
    modules |= {alias.name for item in tree if isinstance(item, ast.Import) for alias in item.names}
    assert modules - sys.stdlib_module_names <= {"launch", "launch_ros", "panoptic_ros"}


def test_the_rig_is_a_node_of_its_own(launch_file: dict[str, Any], rig_file: Path) -> None:
    started = _started(launch_file, rig=str(rig_file), devices="left=0 right=1", namespace="lab")
    (rig,) = [item.options for item in started if type(item).__name__ == "Node"]
    assert (rig["package"], rig["executable"], rig["namespace"]) == ("panoptic_ros", "rig", "lab")
    assert read_rig(Path(rig["parameters"][0]["rig"])).names == ("left", "right")
    assert _document(started)["namespace"] == "lab"


def _run_document(folder: Path, *words: str) -> dict[str, Any]:
    """The file of nodes and processes of `panoptic run`."""
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    args = parser.parse_args([*words, "--out", "-"])
    publish = tuple(names(args.publish) or ())
    plan, _ = without_patch_inputs(replace(make_plan(args), publish=publish, namespace=args.namespace))
    folder.mkdir()
    path = write_launch_file(plan, folder, *flow_of(plan), args.jpeg, args.node_per_stage)
    document: dict[str, Any] = json.loads(path.read_text())
    return document


def test_ros2_launch_starts_the_nodes_of_panoptic_run(
    launch_file: dict[str, Any], rig_file: Path, tmp_path: Path
) -> None:
    """The graph is divided once, for both: also with subjects, a preset, words to publish, a namespace."""
    subject = {"format": "panoptic-subject-1", "id": 4, "height_m": 1.7}
    (tmp_path / "anna.json").write_text(json.dumps(subject))
    (tmp_path / "parameters.yaml").write_text("tracking: {max_distance: 0.4}\noffsets: {active: true}\n")
    files = {name: str(tmp_path / name) for name in ("anna.json", "parameters.yaml")}
    pictures(rig_file.parent)
    cases = (
        ({"capture": str(rig_file.parent)}, [str(rig_file.parent)]),
        (
            {
                "rig": str(rig_file),
                "devices": "left=/dev/video0 right=rtsp://host/stream?a=b",
                "microphones": "mic=hw:1",
                "subjects": files["anna.json"],
                "preset": "panoptic-studio",
                "config": files["parameters.yaml"],
                "publish": "roots,heat_maps",
                "namespace": "lab",
                "node_per_stage": "true",
            },
            [
                *("--rig", str(rig_file), "--device", "left=/dev/video0"),
                *("--device", "right=rtsp://host/stream?a=b", "--microphone", "mic=hw:1"),
                *("--subject", files["anna.json"], "--preset", "panoptic-studio"),
                *("--config", files["parameters.yaml"], "--publish", "roots,heat_maps"),
                *("--namespace", "lab", "--node-per-stage"),
            ],
        ),
    )
    for number, (given, words) in enumerate(cases):
        launched = _document(_started(launch_file, **given))
        run = _run_document(tmp_path / f"run-{number}", *words, "--jpeg", "90")
        assert {**launched, "rig": ""} == {**run, "rig": ""}
        assert Path(launched["rig"]).read_text() == Path(run["rig"]).read_text()
    assert {"offsets", "kinematics", "mic", "fusion"} & set(launched["processes"]) == {
        "offsets",
        "kinematics",
    }


OFF = {
    "offsets",
    "continuous",
    "kinematics",
    "flow",
    "patches",
    "appearance",
}  # unless parameters say otherwise


def test_devices_start_every_stage(launch_file: dict[str, Any], rig_file: Path) -> None:
    given = {"rig": str(rig_file), "devices": "left=/dev/video0 right=1", "audio": "recorder"}
    nodes = _nodes(launch_file, **given)
    assert set(nodes) == {"detection_0", "fusion", "markers"}
    assert nodes["detection_0"]["own"]["sources"]["left"]["device"] == "/dev/video0"
    assert nodes["fusion"]["parameters"]["devices"] == ["recorder"]
    assert {item["parameters"]["flow"] for item in nodes.values()} == {"live"}
    nodes = _nodes(launch_file, **given, node_per_stage="true")
    assert set(nodes) == {"detection_0", "markers", *(set(NODES) - OFF - {"detection"})}


def test_parameters_of_a_file_reach_their_stage(
    launch_file: dict[str, Any], rig_file: Path, tmp_path: Path
) -> None:
    (tmp_path / "parameters.yaml").write_text("tracking: {max_distance: 0.4}\n")
    given = {"rig": str(rig_file), "devices": "left=0 right=1", "config": str(tmp_path / "parameters.yaml")}
    nodes = _nodes(launch_file, **given)
    assert nodes["fusion"]["parameters"]["tracking.max_distance"] == 0.4
    assert "tracking.max_distance" not in nodes["detection_0"]["parameters"]
    assert "timecode" not in nodes["fusion"]["stages"]  # nobody named an audio device
    assert "offsets" not in nodes
    for stage in ("offsets", "continuous"):
        (tmp_path / "parameters.yaml").write_text(f"{stage}: {{active: true}}\n")
        assert _nodes(launch_file, **given)[stage]["parameters"]["active"]


def test_a_capture_folder_is_replayed(launch_file: dict[str, Any], rig_file: Path) -> None:
    pictures(rig_file.parent)
    for flow in ("replay", "live"):
        nodes = _nodes(launch_file, capture=str(rig_file.parent), flow="" if flow == "replay" else flow)
        assert {item["parameters"]["flow"] for item in nodes.values()} == {flow}
        (looking,) = [item for item in nodes.values() if "detection" in item.get("stages", ())]
        assert looking["own"]["sources"]["left"]["path"] == str(rig_file.parent)


@pytest.mark.parametrize("text", ["true", "false"])
def test_processes_are_started_anew_if_asked_for(
    launch_file: dict[str, Any], rig_file: Path, text: str
) -> None:
    given = {"rig": str(rig_file), "devices": "left=0 right=1"}
    started = _started(launch_file, **given, respawn=text)
    assert {item.options["respawn"] for item in started} == {text == "true"}
    with pytest.raises(UsageError, match="respawn:=maybe"):
        _nodes(launch_file, **given, respawn="maybe")


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({}, "devices"),
        ({"capture": "a", "devices": "left=0"}, "devices"),
        ({"devices": "left=0"}, "devices"),
        ({"devices": "left"}, "devices"),
        ({"devices": "left=0 right=1", "flow": "replay"}, "flow"),
    ],
)
def test_wrong_arguments_are_refused(
    launch_file: dict[str, Any], rig_file: Path, given: dict[str, str], told: str
) -> None:
    rig = {} if given.get("devices") == "left=0" else {"rig": str(rig_file)}
    with pytest.raises(UsageError, match=told):
        _nodes(launch_file, **{**rig, **given} if given.get("devices") else given)


def test_a_recording_with_a_node_per_stage_is_refused(launch_file: dict[str, Any], rig_file: Path) -> None:
    pictures(rig_file.parent)
    with pytest.raises(UsageError, match="live use only: leave it out"):
        _nodes(launch_file, capture=str(rig_file.parent), node_per_stage="true")
