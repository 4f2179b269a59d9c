"""Which nodes a run consists of and which process each of them lives in."""
from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from panoptic_ros.graph.flow import live_defaults
from panoptic_ros.graph.nodes import FUSION
from panoptic_ros.graph.topics import ros_name
from panoptic_ros.io.files import write_json
from panoptic_ros.io.occluders import FILE as OCCLUDERS
from panoptic_ros.io.occluders import write_occluders
from panoptic_ros.io.rigs import write_rig
from panoptic_ros.offsets.config import OffsetsConfig
from panoptic_ros.params import config_of, diff
from panoptic_ros.running.plan import Plan

CAMERA_PROCESSES = 8  # at most; beyond it, cameras share processes


def write_launch_file(plan: Plan, folder: Path, flow: str, window: int, jpeg_quality: int) -> Path:
    """Which nodes run in which process, for `nodes.main host`."""
    rig = folder / "rig.json"
    write_rig(rig, plan.rig)
    if plan.rig.occluders is not None:
        write_occluders(folder / OCCLUDERS, plan.rig.occluders)
    common = {"flow": flow, "window": window}
    processes: dict[str, list[dict[str, Any]]] = {}

    def stage(name: str, **more: Any) -> dict[str, Any]:
        config = plan.configs[name]
        own = {key: value for key, value in diff(config).items() if value != []}
        own |= {key: getattr(config, key) for key in live_defaults(flow, name)}
        return {"kind": "stage", "stage": name, "name": name, "parameters": {**common, **own, **more}}

    if plan.streams:
        streams = [{**vars(stream), "bag": str(stream.bag)} for stream in plan.streams]
        processes["source"] = [{"kind": "bag", "name": "bag", "streams": streams, "parameters": common}]
    for i, (camera, source) in enumerate(plan.sources.items()):
        node = {"kind": "camera", "camera": camera, "source": source, "jpeg_quality": jpeg_quality,
                "parameters": common}  # fmt: skip
        few = len(plan.sources) <= CAMERA_PROCESSES
        name = f"camera-{ros_name(camera)}" if few else f"cameras-{i % CAMERA_PROCESSES}"
        processes.setdefault(name, []).append(node)
    if plan.stage == "detection":
        compressed = bool(jpeg_quality) or any(s.key == "compressed_image" for s in plan.streams)
        for k, cameras in enumerate(_shares(list(plan.rig.names), plan.live)):
            packed = {s.camera for s in plan.streams if s.key == "compressed_depth"}
            depths = {
                "depths": [c for c in cameras if c in plan.depth_cameras and c not in packed],
                "compressed_depths": [c for c in cameras if c in packed],
            }
            node = stage("detection", cameras=cameras, compressed=compressed, **_if_any(depths))
            processes[f"detection-{k}"] = [{**node, "name": f"detection_{k}"}]
    if config_of(plan.configs, OffsetsConfig).active:
        processes["offsets"] = [stage("offsets")]
    fusion = [stage(name) for name in ("sync", *FUSION)]
    processes["fusion"] = [*fusion, {"kind": "markers", "parameters": {"flow": flow}}]
    path = folder / "launch.json"
    write_json(path, {"rig": str(rig), "processes": processes}, indent=1)
    return path


def _if_any(parameters: dict[str, list[str]]) -> dict[str, list[str]]:
    """ROS knows no type for an empty list."""
    return {name: values for name, values in parameters.items() if values}


def _shares(cameras: list[str], live: bool) -> list[list[str]]:
    """Cameras per detection process.

    Replay: as many processes as leave every other core to the rest. Live: one, so that all cameras
    drop the same instants when it cannot keep up; it has several threads instead.
    """
    count = 1 if live else max(1, min(len(cameras), (os.cpu_count() or 2) // 2))
    return [cameras[k::count] for k in range(count)]
