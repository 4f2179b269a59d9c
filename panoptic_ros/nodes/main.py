"""Entry points of the executables.

`ros2 run panoptic_ros <node>` starts one node. `host` runs the nodes of one process, which a launcher lists
in a JSON file.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from rclpy.node import Node

from panoptic_ros.detection.budget import Processor
from panoptic_ros.detection.upright import NOT_KNOWN
from panoptic_ros.domain import NO_CAMERAS, SkeletonModel
from panoptic_ros.domain.upright import Z_UP
from panoptic_ros.errors import UsageError
from panoptic_ros.graph.nodes import AFTER_DETECTION, NODES
from panoptic_ros.io.body_context import body_extras
from panoptic_ros.io.detector_context import bias_extras, detector_extras
from panoptic_ros.io.models import DEFAULT_MODEL
from panoptic_ros.io.occluders import read_occluders
from panoptic_ros.io.output import print_to
from panoptic_ros.io.rigs import read_rig
from panoptic_ros.io.skeletons import DEFAULT_SKELETON
from panoptic_ros.nodes.listeners.heat_maps_node import HeatMapsNode
from panoptic_ros.nodes.listeners.people_node import MarkersNode, PeopleNode
from panoptic_ros.nodes.listeners.rpt_node import RptNode
from panoptic_ros.nodes.middleware.runtime import in_namespace, leave, run_nodes
from panoptic_ros.nodes.sources.statics_node import StaticsNode
from panoptic_ros.nodes.stages.own_cameras import OwnCameras
from panoptic_ros.nodes.stages.stage_node import StageNode


def _detector(node: Node, prefix: str, skeleton: SkeletonModel) -> Mapping[str, Any]:
    """Return the extras of the detection stage: the detector that the parameter `model` names.

    In live flow they also hold the processor budget that the stage may use.
    """
    extras = detector_extras(node.get_parameter(f"{prefix}model").value, skeleton.name)[1]
    if node.get_parameter("flow").value != "live":
        return extras
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return {**extras, "processor": Processor(cores, time.thread_time)}


def _biases(node: Node, prefix: str, skeleton: SkeletonModel) -> Mapping[str, Any]:
    """Return the extras of the assembly stage: the table that the parameter `bias_table` names."""
    return bias_extras(node.get_parameter(f"{prefix}bias_table").value, skeleton)


def _bodies(node: Node, prefix: str, skeleton: SkeletonModel) -> Mapping[str, Any]:
    """Return the extras of the kinematics stage, read from the files that its parameters name."""
    given = node.get_parameter_or(f"{prefix}subjects").value  # rclpy leaves a list without entries unset
    names = [Path(path) for path in given or ()]
    words = ("segments", "prior", "offsets")
    return body_extras(names, *(node.get_parameter(f"{prefix}{name}").value for name in words))


EXTRAS = {"detection": _detector, "assembly": _biases, "kinematics": _bodies}


def make_stage_node(
    stages: str | Sequence[str],
    overrides: Mapping[str, Any] = {},
    name: str | None = None,
    own: OwnCameras | None = None,
) -> StageNode:
    """Return the node that runs one stage or several stages."""
    return StageNode(stages, overrides, EXTRAS, name, own)


def __getattr__(name: str) -> Callable[[], None]:
    """Return the executable of a stage for `ros2 run panoptic_ros <stage>`.

    Every row of `graph.nodes.NODES` is an executable.

    Raises:
        AttributeError: if no stage has this name.
    """
    if name not in NODES:
        raise AttributeError(f"module {__name__} has no attribute {name!r}")
    return lambda: leave(run_nodes(lambda: [make_stage_node(name)]))


def fusion() -> None:
    """Run all stages after detection in one node: 2D poses in, /skeletons out."""
    leave(run_nodes(lambda: [make_stage_node(AFTER_DETECTION, name="fusion"), MarkersNode()]))


def markers() -> None:
    """Run the node that publishes skeletons as markers for RViz and Foxglove."""
    leave(run_nodes(lambda: [MarkersNode()]))


def people() -> None:
    """Run the node that publishes skeletons for other packages: roots, TF, REP-155 bodies, boxes."""
    leave(run_nodes(lambda: [PeopleNode()]))


def heat_maps() -> None:
    """Run the node that publishes score maps as images to subscribers."""
    leave(run_nodes(lambda: [HeatMapsNode()]))


def rpt() -> None:
    """Run the node that converts the 2D poses of RapidPoseTriangulation into detections of this graph."""
    leave(run_nodes(lambda: [RptNode()]))


class _Arguments(Node):
    """Node that reads the parameters of an executable before the actual node is made."""

    def __init__(self, name: str):
        super().__init__(name)

    def text(self, name: str, default: str = "") -> str:
        """Declare a string parameter and return its value."""
        return str(self.declare_parameter(name, default).value)


def rig() -> None:
    """Run the node that publishes the rig and the skeleton model.

    Parameters: `rig` and `occluders` (files), `skeleton`, `model`.
    """

    def make() -> Sequence[Any]:
        arguments = _Arguments("rig_parameters")
        path, skeleton = arguments.text("rig"), arguments.text("skeleton", DEFAULT_SKELETON)
        model, occluders = arguments.text("model", DEFAULT_MODEL), arguments.text("occluders")
        arguments.destroy_node()
        if not path:
            raise UsageError("node rig needs the parameter `rig`, the path of a calibration")
        among = read_rig(Path(path))
        if occluders:
            among = replace(among, occluders=read_occluders(Path(occluders)))
        node = StaticsNode(among, detector_extras(model, skeleton)[0])
        for line in among.notices:
            node.get_logger().warning(line)
        if among.up != Z_UP:
            up = list(among.up or NOT_KNOWN)
            node.get_logger().warning(f"/rig does not carry up: give node detection the parameter up: {up}")
        return [node]

    leave(run_nodes(make))


def camera() -> None:
    """Run the node of one camera.

    Parameters: `camera` (name), `rig` (file), and either `device` or `video` (file). A video starts at the
    timestamp `start_ns`.
    """

    def make() -> Sequence[Any]:
        arguments = _Arguments("camera_parameters")
        name, path = arguments.text("camera"), arguments.text("rig")
        video, device = arguments.text("video"), arguments.text("device")
        quality = int(arguments.declare_parameter("jpeg_quality", 90).value)
        start_ns = int(arguments.declare_parameter("start_ns", 0).value)
        flow = arguments.text("flow", "live")
        arguments.destroy_node()
        from panoptic_ros.nodes.sources.making import make_camera_node

        if not name or not path or bool(video) == bool(device):
            raise UsageError("node camera needs the parameters `camera`, `rig`, and `video` or `device`")
        recorded = {"kind": "file", "path": video, "start_ns": start_ns}
        source = recorded if video else {"kind": "device", "device": device}
        return [make_camera_node(name, read_rig(Path(path)), source, {"flow": flow}, quality)]

    leave(run_nodes(make))


def host(arguments: Sequence[str] | None = None) -> int:
    """Run one process of a launcher's file until the launcher ends; return the exit code.

    Args:
        arguments: FILE, PROCESS and PID (of the launcher). If they are missing, the launcher sends them later
            on standard input.
    """
    path, process, launcher = list(sys.argv[1:] if arguments is None else arguments) or _told()
    document = json.loads(Path(path).read_text())
    rig_of_run = read_rig(Path(document["rig"])) if document["rig"] else NO_CAMERAS

    def make() -> Sequence[Any]:
        return [_hosted(entry, rig_of_run) for entry in document["processes"][process]]

    return run_nodes(make, in_namespace(document.get("namespace", "")), lambda: os.getppid() == int(launcher))


def _told() -> list[str]:
    """Read the arguments of `host` and the log file from one line of standard input.

    End the process if standard input ends without a line.
    """
    line = sys.stdin.readline()
    if not line:
        leave(0)
    path, process, launcher, log = map(str, json.loads(line))
    print_to(log)
    return [path, process, launcher]


def _hosted(entry: Mapping[str, Any], rig_of_run: Any) -> Any:
    overrides = dict(entry.get("parameters", {}))
    if entry["kind"] == "stages":
        own = OwnCameras(**entry["own"]) if "own" in entry else None
        return make_stage_node(entry["stages"], overrides, entry["name"], own)
    if entry["kind"] == "markers":
        return MarkersNode(overrides.get("flow", "live"))
    if entry["kind"] == "heat_maps":
        return HeatMapsNode()
    if entry["kind"] == "people":
        return PeopleNode(overrides.pop("flow", "live"), overrides)
    return _source(entry, rig_of_run, overrides)


def _source(entry: Mapping[str, Any], rig_of_run: Any, overrides: Mapping[str, Any]) -> Any:
    """Return the source node of an entry: sound, IMUs or bags.

    Raises:
        UsageError: if there is no node of this kind.
    """
    # Import here: stage nodes start faster without these decoders.
    from panoptic_ros.io.bag_streams import BagStream
    from panoptic_ros.nodes.sources.making import make_bag_node, make_imu_node, make_sound_node

    if entry["kind"] == "sound":
        return make_sound_node(entry["sound"], rig_of_run.names, overrides)
    if entry["kind"] == "imus":
        return make_imu_node(entry["imus"], rig_of_run.names, overrides, entry["until_ns"])
    if entry["kind"] == "bag":
        streams = [BagStream.from_words(stream) for stream in entry["streams"]]
        return make_bag_node(streams, overrides)
    raise UsageError(f"there is no node of kind {entry['kind']!r}")


if __name__ == "__main__":
    leave(host(sys.argv[2:] if sys.argv[1:2] == ["host"] else sys.argv[1:]))
