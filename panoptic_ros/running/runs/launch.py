"""Which nodes a run consists of and which process each of them lives in."""
from __future__ import annotations

from pathlib import Path
from typing import Any

from panoptic_ros.graph.build import ports_in_use, rows_in_use, switched_on
from panoptic_ros.graph.flow import live_defaults
from panoptic_ros.graph.nodes import BESIDE_IMAGES, SLOW, SOUND
from panoptic_ros.graph.topics import TOPICS, given_inputs, ros_name
from panoptic_ros.graph.wiring import Wiring
from panoptic_ros.io.bag_streams import SOUND_KEY
from panoptic_ros.io.files import write_json
from panoptic_ros.io.occluders import FILE as OCCLUDERS
from panoptic_ros.io.occluders import write_occluders
from panoptic_ros.io.rigs import write_rig
from panoptic_ros.params import diff
from panoptic_ros.running.plans.plan import Plan
from panoptic_ros.running.runs.side_by_side import free_threads

CAMERA_PROCESSES = 8  # at most; beyond it, cameras share processes
HEAT_MAPS = "heat_maps"  # what is published of views, not of people
SOUND_PROCESSES = 2  # at most, the same


def write_launch_file(
    plan: Plan, folder: Path, flow: str, window: int, jpeg_quality: int, one_per_stage: bool = False
) -> Path:
    """Which nodes run in which process, for `nodes.main host`.

    Args:
        one_per_stage: a node and a process for each stage, in place of one for all after detection.
            In replay, where tracking tells detection where to look, one process runs all stages.
    """
    rig = folder / "rig.json"
    write_rig(rig, plan.rig)
    if plan.rig.occluders is not None:
        write_occluders(folder / OCCLUDERS, plan.rig.occluders)
    plan_of_nodes = _Nodes(plan, flow, window)
    processes: dict[str, list[dict[str, Any]]] = {}
    if plan.streams:
        streams = [stream.words() for stream in plan.streams]
        bag = {"kind": "bag", "name": "bag", "streams": streams, "parameters": plan_of_nodes.common}
        processes["source"] = [bag]
    for i, (camera, source) in enumerate(plan.sources.items()):
        node = {"kind": "camera", "camera": camera, "source": source, "jpeg_quality": jpeg_quality,
                "parameters": plan_of_nodes.source(camera)}  # fmt: skip
        few = len(plan.sources) <= CAMERA_PROCESSES
        name = f"camera-{ros_name(camera)}" if few else f"cameras-{i % CAMERA_PROCESSES}"
        processes.setdefault(name, []).append(node)
    for i, sound in enumerate(plan.sounds):
        device = str(sound["device"])
        parameters = plan_of_nodes.source(TOPICS[SOUND_KEY].of(device))
        node = {"kind": "sound", "sound": dict(sound), "parameters": parameters}
        few = len(plan.sounds) <= SOUND_PROCESSES
        name = f"sound-{ros_name(device)}" if few else f"sounds-{i % SOUND_PROCESSES}"
        processes.setdefault(name, []).append(node)
    if plan.imus:
        paths = {device: str(path) for device, path in plan.imus.items()}
        processes["imus"] = [{"kind": "imus", "imus": paths, "parameters": plan_of_nodes.common}]
    guided = plan_of_nodes.guided and not plan.live  # then what comes back must come at its place
    beside = tuple(name for name in BESIDE_IMAGES if name in plan_of_nodes.stages)
    if plan.stage == "detection" and not guided:
        for k, cameras in enumerate(_shares(list(plan.rig.names), plan.live)):
            inputs = _inputs_of_detection(plan, cameras, bool(jpeg_quality))
            processes[f"detection-{k}"] = [
                plan_of_nodes.node(beside, f"detection_{k}", cameras=cameras, **inputs)
            ]
    apart = [name for name in plan_of_nodes.stages if plan.live and name in SLOW]
    alone = apart if guided else [*beside, *apart]
    together = [name for name in plan_of_nodes.stages if name not in alone]
    divided = one_per_stage and not guided
    hosts = _divided(together) if divided else [tuple(together)]
    inputs = _inputs_of_detection(plan, list(plan.rig.names), bool(jpeg_quality)) if guided else {}
    for host in (*hosts, *((name,) for name in apart)):
        name = host[0] if len(host) == 1 else "sync" if divided else "fusion"
        processes.setdefault("fusion" if host in hosts and not divided else name, []).append(
            plan_of_nodes.node(host, name, **(inputs if "detection" in host else {}))
        )
    markers = {"kind": "markers", "parameters": {"flow": flow}}
    processes.setdefault("markers" if divided else "fusion", []).append(markers)
    others = processes.setdefault("markers" if one_per_stage else "fusion", [])
    if words := [word for word in plan.publish if word != HEAT_MAPS]:
        others.append({"kind": "people", "parameters": {"flow": flow, "publish": words}})
    if HEAT_MAPS in plan.publish:
        processes["heat-maps"] = [{"kind": "heat_maps"}]
    path = folder / "launch.json"
    document = {"rig": str(rig), "namespace": plan.namespace, "processes": processes}
    write_json(path, document, indent=1)
    return path


def _divided(stages: list[str]) -> list[tuple[str, ...]]:
    """A host for every stage. Sound is heard where its clocks are used: only there is its place among frames
    known.
    """
    heard = [name for name in stages if name in (*SOUND, "sync")]
    return [tuple(heard), *((name,) for name in stages if name not in heard)]


class _Nodes:
    """Nodes of stages with their parameters."""

    def __init__(self, plan: Plan, flow: str, window: int):
        self._plan, self._flow = plan, flow
        self.stages = switched_on(plan.stages, plan.configs)
        self._used = ports_in_use({name: plan.configs[name] for name in self.stages})
        self.guided = any(port.startswith("detection.") for port in self._used)
        self.common = {"flow": flow, "window": window}

    def source(self, owner: str) -> dict[str, Any]:
        """Parameters of a camera, or of a device by the topic of its sound."""
        shifts = self._plan.shifts
        return {**self.common, **({"shift_ns": shifts[owner]} if owner in shifts else {})}

    def node(self, stages: tuple[str, ...], name: str, **more: Any) -> dict[str, Any]:
        """The node of connected stages."""
        parameters = {
            **self.common, "graph": [*self.stages, *self._used], "marked": self._is_marked(stages), **more,
        }  # fmt: skip
        if set(SOUND) & set(stages):
            parameters |= {"devices": list(self._plan.devices)}
        if self._plan.shifts:
            parameters |= {"shifts": [f"{owner}={ns}" for owner, ns in self._plan.shifts.items()]}
        if "kinematics" in stages:
            parameters |= given_inputs({"imu": self._plan.imu_devices})
        for stage in stages:
            prefix = f"{stage}." if len(stages) > 1 else ""
            parameters |= {prefix + key: value for key, value in self._own(stage).items()}
        return {"kind": "stages", "stages": list(stages), "name": name, "parameters": parameters}

    def _own(self, stage: str) -> dict[str, Any]:
        """What differs from the defaults, and what live flow has other defaults of."""
        config = self._plan.configs[stage]
        own = {key: value for key, value in diff(config).items() if value != []}
        return own | {key: getattr(config, key) for key in live_defaults(self._flow, stage)}

    def _is_marked(self, stages: tuple[str, ...]) -> bool:
        """Whether something comes back over the borders of processes, in replay."""
        table = rows_in_use(self._used)
        everything = Wiring(self.stages, table=table)
        inside = Wiring(stages, self.stages, table)
        return self._flow == "replay" and bool(everything.heads) and set(inside.given_around) != inside.given


def _inputs_of_detection(plan: Plan, cameras: list[str], jpeg: bool) -> dict[str, list[str]]:
    """Which messages come, by parameter of the node."""
    packed = {stream.camera for stream in plan.streams if stream.key == "compressed_depth"}
    packed |= set(plan.topics.get("compressed_depth", ()))
    compressed = {stream.camera for stream in plan.streams if stream.key == "compressed_image"}
    compressed |= set(plan.topics.get("compressed_image", ()))
    renamed = [
        f"{key} {camera}={name}"
        for key, names in plan.topics.items() for camera, name in names.items() if camera in cameras
    ]  # fmt: skip
    encodings = [f"{camera}={name}" for camera, name in plan.encodings.items() if camera in cameras]
    others = {key: values for key, values in (("topics", renamed), ("encodings", encodings)) if values}
    return others | given_inputs({
        "depth": [c for c in cameras if c in plan.depth_cameras],
        "compressed_depth": [c for c in cameras if c in packed],
        "compressed_image": [c for c in cameras if jpeg or c in compressed],
    })  # fmt: skip


def _shares(cameras: list[str], live: bool) -> list[list[str]]:
    """Cameras per detection process.

    Replay: one for every core that may be used: the network is nearly all of the work. Live: one, so that all
    cameras drop the same instants when it cannot keep up; it has several threads instead.
    """
    count = 1 if live else min(len(cameras), free_threads(1))
    return [cameras[k::count] for k in range(count)]
