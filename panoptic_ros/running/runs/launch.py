"""Decides which nodes a run consists of, and in which process each of them runs."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

from panoptic_ros.detection.config import DetectionConfig
from panoptic_ros.errors import UsageError
from panoptic_ros.graph.build import ports_in_use, switched_on
from panoptic_ros.graph.flow import WINDOW, live_defaults
from panoptic_ros.graph.nodes import BESIDE_IMAGES, SLOW, SOUND
from panoptic_ros.graph.topics import TOPICS, given_inputs, ros_name
from panoptic_ros.io.bag_streams import SENSOR_KEYS, SOUND_KEY, TRACKS_KEY
from panoptic_ros.io.files import write_json
from panoptic_ros.io.occluders import FILE as OCCLUDERS
from panoptic_ros.io.occluders import write_occluders
from panoptic_ros.io.rigs import write_rig
from panoptic_ros.kinematics.config import KinematicsConfig
from panoptic_ros.params import config_of, diff
from panoptic_ros.refinement.config import RefinementConfig
from panoptic_ros.running.plans.free_threads import free_threads
from panoptic_ros.running.plans.plan import Plan
from panoptic_ros.stage import Notice

# images in detection at a time per process; the network holds Python's lock for a tenth of its time
LOOKS_OF_A_PROCESS = 8
HEAT_MAPS = "heat_maps"  # entry of `publish` that is about views; all others are about people
SOUND_PROCESSES = 2  # maximum number of processes for sound


def flow_of(plan: Plan) -> tuple[str, int]:
    """Return name and window of the flow of a plan's nodes, see `graph.flow.make_flow`."""
    lag_s = config_of(plan.configs, RefinementConfig).lag
    return "live" if plan.live else "replay", WINDOW + math.ceil(plan.frame_rate * lag_s)


def without_patch_inputs(plan: Plan) -> tuple[Plan, tuple[Notice, ...]]:
    """Return the plan of a run over several processes, and a notice about what it leaves out.

    Recorded depth maps and recorded 2D tracks are left out.
    """
    left = tuple(stream for stream in plan.streams if stream.key not in (*SENSOR_KEYS, TRACKS_KEY))
    if not plan.maps and left == plan.streams:
        return plan, ()
    text = "patches go without recorded depth maps and 2D tracks here: add --in-process or --offline"
    return replace(plan, maps=(), streams=left), (Notice("patches.inputs_left_out", "warning", text),)


def write_launch_file(
    plan: Plan, folder: Path, flow: str, window: int, jpeg_quality: int, one_per_stage: bool = False
) -> Path:
    """Write launch.json, which assigns nodes to processes for `nodes.main host`; return its path.

    Both `panoptic run` and `ros2 launch` use this file.

    Args:
        flow, window: See `flow_of`.
        jpeg_quality: 1-100: images are published as JPEG; 0: uncompressed.
        one_per_stage: Live: a node and a process per stage, instead of one for all stages after detection.

    Raises:
        UsageError: if `one_per_stage` is set for a recording.
    """
    if one_per_stage and not plan.live:
        raise UsageError(f"--node-per-stage is for live use only: leave it out for {plan.title}, a recording")
    rig = folder / "rig.json"
    if plan.rig.cameras:
        write_rig(rig, plan.rig)
    if plan.rig.occluders is not None:
        write_occluders(folder / OCCLUDERS, plan.rig.occluders)
    plan_of_nodes = _NodeEntries(plan, flow, window)
    processes: dict[str, list[dict[str, Any]]] = {}
    if plan.streams:
        streams = [stream.words() for stream in plan.streams]
        bag = {"kind": "bag", "name": "bag", "streams": streams, "parameters": plan_of_nodes.bodies}
        processes["source"] = [bag]
    for i, sound in enumerate(plan.sounds):
        device = str(sound["device"])
        parameters = plan_of_nodes.source(TOPICS[SOUND_KEY].of(device))
        node = {"kind": "sound", "sound": dict(sound), "parameters": parameters}
        few = len(plan.sounds) <= SOUND_PROCESSES
        name = f"sound-{ros_name(device)}" if few else f"sounds-{i % SOUND_PROCESSES}"
        processes.setdefault(name, []).append(node)
    if plan.imus:
        paths = {device: str(path) for device, path in plan.imus.items()}
        processes["imus"] = [
            {"kind": "imus", "imus": paths, "until_ns": plan.until_ns, "parameters": plan_of_nodes.bodies}
        ]
    joined = _is_joined(plan, plan_of_nodes.guided)
    beside = tuple(name for name in BESIDE_IMAGES if name in plan_of_nodes.stages)
    if plan.stage == "detection" and not joined:
        for k, cameras in enumerate(_shares(plan)):
            inputs = _inputs_of_detection(plan, cameras)
            processes[f"detection-{k}"] = [
                plan_of_nodes.node(beside, f"detection_{k}", cameras=cameras, **inputs)
                | _own(plan, cameras, jpeg_quality)
            ]
    apart = [name for name in plan_of_nodes.stages if plan.live and name in SLOW]
    alone = apart if joined else [*beside, *apart]
    together = [name for name in plan_of_nodes.stages if name not in alone]
    hosts = [(name,) for name in together] if one_per_stage else [tuple(together)] if together else []
    inputs = _inputs_of_detection(plan, list(plan.rig.names)) if joined else {}
    for host in (*hosts, *((name,) for name in apart)):
        name = host[0] if len(host) == 1 else "fusion"
        looks = "detection" in host
        node = plan_of_nodes.node(host, name, **(inputs if looks else {}))
        node |= _own(plan, list(plan.rig.names), jpeg_quality) if looks else {}
        processes.setdefault("fusion" if host in hosts and not one_per_stage else name, []).append(node)
    if plan.rig.cameras:
        markers = {"kind": "markers", "parameters": {"flow": flow}}
        processes.setdefault("markers" if one_per_stage else "fusion", []).append(markers)
    if words := [word for word in plan.publish if word != HEAT_MAPS]:
        others = processes.setdefault("markers" if one_per_stage else "fusion", [])
        segments = config_of(plan.configs, KinematicsConfig).segments
        parameters = {"flow": flow, "publish": words, "segments": segments}
        others.append({"kind": "people", "parameters": parameters})
    if HEAT_MAPS in plan.publish:
        processes["heat-maps"] = [{"kind": "heat_maps"}]
    path = folder / "launch.json"
    known = str(rig) if plan.rig.cameras else ""
    document = {"rig": known, "namespace": plan.namespace, "processes": processes}
    write_json(path, document, indent=1)
    return path


def _is_joined(plan: Plan, guided: bool) -> bool:
    """Return whether one process runs all stages, including detection.

    This holds in replay only, in two cases:
    - Tracking guides detection. Its feedback must arrive at a fixed place in the sequence.
    - Detection reads the images itself, and one process can use all cores. Then only the kept records are
      sent.
    """
    fills = bool(plan.sources) and free_threads(1) <= LOOKS_OF_A_PROCESS
    return not plan.live and plan.stage == "detection" and (guided or fills)


class _NodeEntries:
    """Builds the launch file entries of stage nodes, with their parameters."""

    def __init__(self, plan: Plan, flow: str, window: int):
        self._plan, self._flow = plan, flow
        self.stages = switched_on(plan.stages, plan.configs)
        self._used = ports_in_use({name: plan.configs[name] for name in self.stages})
        self.guided = any(port.startswith("detection.") for port in self._used)
        self.common = {"flow": flow, "replay_window": window}

    @property
    def bodies(self) -> dict[str, Any]:
        """Return the parameters of nodes that publish IMU samples.

        Without cameras, both kinematics and the launcher read all samples, which makes two readers.
        """
        return self.common if self._plan.rig.cameras else {**self.common, "readers": 2}

    def source(self, owner: str) -> dict[str, Any]:
        """Return the parameters of the source of a camera, or of a device's sound.

        Args:
            owner: camera name, or topic of the sound.
        """
        shifts = self._plan.shifts
        return {**self.common, **({"shift_ns": shifts[owner]} if owner in shifts else {})}

    def node(self, stages: tuple[str, ...], name: str, **more: Any) -> dict[str, Any]:
        """Return the entry of one node that runs connected stages."""
        parameters = {
            **self.common,
            "graph": [*self.stages, *self._used],
            **more,
        }
        if set(SOUND) & set(stages):
            parameters |= {"devices": list(self._plan.devices)}
        if self._plan.shifts:
            parameters |= {"shifts": [f"{owner}={ns}" for owner, ns in self._plan.shifts.items()]}
        if "patches" in stages:
            parameters |= _inputs_of_patches(self._plan)
        if "kinematics" in stages:
            parameters |= given_inputs({"imu": self._plan.imu_devices})
        for stage in stages:
            prefix = f"{stage}." if len(stages) > 1 else ""
            parameters |= {prefix + key: value for key, value in self._own(stage).items()}
        return {"kind": "stages", "stages": list(stages), "name": name, "parameters": parameters}

    def _own(self, stage: str) -> dict[str, Any]:
        """Return the parameters of a stage that the node does not have by default.

        They are the parameters that differ from their defaults, and those with other defaults in live flow.
        Changed parameters that are empty lists are left out.
        """
        config = self._plan.configs[stage]
        own = {key: value for key, value in diff(config).items() if value != []}
        return own | {key: getattr(config, key) for key in live_defaults(self._flow, stage)}


def _inputs_of_detection(plan: Plan, cameras: list[str]) -> dict[str, list[str]]:
    """Return the input topics of a detection node as node parameters."""
    packed = {stream.camera for stream in plan.streams if stream.key == "compressed_depth"}
    packed |= set(plan.topics.get("compressed_depth", ()))
    compressed = {stream.camera for stream in plan.streams if stream.key == "compressed_image"}
    compressed |= set(plan.topics.get("compressed_image", ()))
    renamed = [
        f"{key} {camera}={name}"
        for key, names in plan.topics.items()
        for camera, name in names.items()
        if camera in cameras
    ]
    encodings = [f"{camera}={name}" for camera, name in plan.encodings.items() if camera in cameras]
    others = {key: values for key, values in (("topics", renamed), ("encodings", encodings)) if values}
    return others | given_inputs(
        {
            "depth": [c for c in cameras if c in plan.depth_cameras],
            "compressed_depth": [c for c in cameras if c in packed],
            "compressed_image": [c for c in cameras if c in compressed],
        }
    )


def _inputs_of_patches(plan: Plan) -> dict[str, list[str]]:
    """Return the topics of depth sensors of running drivers as node parameters."""
    raw, packed = (plan.topics.get(key, {}) for key in ("sensor_depth", "compressed_sensor_depth"))
    renamed = [
        f"{key} {sensor}={name}"
        for key, names in (("sensor_depth", raw), ("compressed_sensor_depth", packed))
        for sensor, name in names.items()
    ]
    own = given_inputs({"sensor_depth": [*raw, *packed], "compressed_sensor_depth": [*packed]})
    return own | ({"topics": renamed} if renamed else {})


def _shares(plan: Plan) -> list[list[str]]:
    """Return the cameras of each detection process.

    Live: one process, so that all cameras drop the same instants when detection is too slow. Recordings that
    the process reads itself: one process per `LOOKS_OF_A_PROCESS` cores, as Python's lock limits each process
    to that many images at a time. Images that arrive as messages, e.g. from bags: one process per usable
    core.
    """
    cameras = list(plan.rig.names)
    each = LOOKS_OF_A_PROCESS if plan.sources else 1
    count = 1 if plan.live else min(len(cameras), math.ceil(free_threads(1) / each))
    return [cameras[k::count] for k in range(count)]


def _own(plan: Plan, cameras: list[str], jpeg_quality: int) -> dict[str, Any]:
    """Return the cameras that a detection process reads itself, and its number of threads."""
    if not plan.sources and not plan.live:
        return {}
    threads = free_threads(config_of(plan.configs, DetectionConfig).threads)
    threads = math.ceil(threads * len(cameras) / len(plan.rig))
    own = {name: plan.sources[name] for name in cameras if name in plan.sources}
    return {"own": {"sources": own, "threads": threads, "jpeg_quality": jpeg_quality}}
