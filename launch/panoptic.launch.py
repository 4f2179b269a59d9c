"""The whole graph in a native Jazzy workspace: cameras, detection, and one node for all that follows.

    ros2 launch panoptic_ros panoptic.launch.py capture:=/path/to/capture
    ros2 launch panoptic_ros panoptic.launch.py rig:=rig.json devices:="left=/dev/video0 right=/dev/video2"

Where ROS comes from the wheels there is no launch system: `panoptic run` starts the same nodes.
"""

from functools import partial
from pathlib import Path

import yaml
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction, SetEnvironmentVariable
from launch_ros.actions import Node

from panoptic_ros.capture import depth_files, open_capture_folder
from panoptic_ros.errors import UsageError
from panoptic_ros.graph.build import configure, ports_in_use, switched_on, with_shared
from panoptic_ros.graph.nodes import AFTER_DETECTION, CHAIN, NODES, SLOW, SOUND
from panoptic_ros.graph.topics import TOPICS, given_inputs, ros_name
from panoptic_ros.graph.wiring import Wiring
from panoptic_ros.io.models import DEFAULT_MODEL
from panoptic_ros.io.occluders import FILE as OCCLUDERS
from panoptic_ros.io.resources import share_folder
from panoptic_ros.io.rigs import find_rig, read_rig
from panoptic_ros.io.skeletons import DEFAULT_SKELETON

ARGUMENTS = {
    "capture": ("", "capture folder: a rig file, and a video or a folder of images per camera"),
    "rig": ("", "calibration file; default: the one in the capture folder"),
    "occluders": ("", "fixed things that hide people; default: occluders.json of the capture folder"),
    "devices": ("", "in place of a capture folder: camera=device or camera=URL, separated by spaces"),
    "audio": ("", "names of audio devices that carry timecode, separated by spaces"),
    "skeleton": (DEFAULT_SKELETON, "skeleton model"),
    "model": (DEFAULT_MODEL, "pose model: the name of a card, or a file"),
    "config": ("", "YAML with parameters, {stage: {name: value}}"),
    "flow": ("", "live (newest first) or replay (nothing is lost); default: replay for a capture folder"),
    "jpeg_quality": ("90", "of the images on the topics"),
    "node_per_stage": ("false", "true: a node and a process for every stage after detection too"),
    "respawn": ("false", "true: a node that ends is started anew; for live use"),
}


def generate_launch_description():
    """Called by `ros2 launch`."""
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=text)
        for name, (default, text) in ARGUMENTS.items()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=start_graph)])


def start_graph(context):
    """Rig, cameras, stages and markers."""
    given = {name: context.launch_configurations[name] for name in ARGUMENTS}
    rig_file, sources = find_cameras(given)
    depths = find_depths(given)
    flow = given["flow"] or ("replay" if given["capture"] else "live")
    settings = yaml.safe_load(Path(given["config"]).read_text()) if given["config"] else {}
    settings = with_shared(settings or {})
    audio = given["audio"].split()
    for name in ("respawn", "node_per_stage"):
        if given[name] not in ("true", "false"):
            raise UsageError(f"{name}:={given[name]}: true or false")
    start = partial(node, respawn=given["respawn"] == "true")
    common = {"rig": str(rig_file), "flow": flow}
    quality = {"jpeg_quality": int(given["jpeg_quality"])}
    chosen = {"skeleton": given["skeleton"], "model": given["model"]}
    profile = str(share_folder() / "config" / "fastdds.xml")  # room for images in shared memory
    actions = [
        SetEnvironmentVariable("FASTRTPS_DEFAULT_PROFILES_FILE", profile),
        start("rig", "rig", {"rig": str(rig_file), "occluders": find_occluders(given), **chosen}),
        start("markers", "markers", {"flow": flow}),
    ]
    for camera, source in sources.items():
        own = {"camera": camera, **common, **quality, **source}
        actions.append(start("camera", f"camera_{ros_name(camera)}", own))
    configs = configure(settings)
    chain = switched_on((*(SOUND if audio else ()), *CHAIN), configs)
    together = [name for name in AFTER_DETECTION if name in chain and not (flow == "live" and name in SLOW)]
    if given["node_per_stage"] == "true":
        together = []
    marked = flow == "replay" and bool(Wiring(chain).heads) and len(chain) > len(together) + 1
    graph = [*chain, *ports_in_use({name: configs[name] for name in chain})]
    shared = {"flow": flow, "cameras": list(sources), "graph": graph, "marked": marked}
    for name in chain:
        own = {**shared, **settings.get(name, {})}
        if name in together:
            continue
        if any(TOPICS[port.topic].scope == "device" for port in NODES[name].inputs):
            own["devices"] = audio
        if name == "detection":
            images = {"compressed_image": list(sources), "depth": depths}
            own |= {"model": given["model"], **given_inputs(images)}
        if name in ("flow", "appearance"):
            own |= given_inputs({"compressed_image": list(sources)})
        actions.append(start(name, name, own))
    if together:
        own = {f"{name}.{key}": value for name in together for key, value in settings.get(name, {}).items()}
        actions.append(start("fusion", "fusion", {**shared, **own}))
    return actions


def find_cameras(given):
    """The rig's file, and {camera: parameters of its node that say where its images come from}."""
    if bool(given["capture"]) == bool(given["devices"]):
        raise UsageError("give one of capture:=FOLDER and devices:='camera=device ...'")
    if given["capture"]:
        folder = Path(given["capture"])
        rig_file = Path(given["rig"]) if given["rig"] else find_rig(folder)
        with open_capture_folder(folder, rig=read_rig(rig_file)) as capture:
            return rig_file, {
                source.camera: {"video": str(source.path), "start_ns": capture.starts.get(source.camera, 0)}
                for source in capture.sources
            }
    if not given["rig"]:
        raise UsageError("devices:= needs rig:=FILE, the calibration of these cameras")
    pairs = [item.partition("=") for item in given["devices"].split()]
    known = read_rig(Path(given["rig"])).names
    for camera, equals, _ in pairs:
        if not equals or camera not in known:
            raise UsageError(f"devices:= names {camera!r}; the rig has {', '.join(known)}")
    return Path(given["rig"]), {camera: {"device": device} for camera, _, device in pairs}


def find_depths(given):
    """The cameras of a capture folder that have depth maps."""
    if not given["capture"]:
        return []
    folder = Path(given["capture"])
    rig = read_rig(Path(given["rig"]) if given["rig"] else find_rig(folder))
    return [name for name in rig.names if depth_files(folder, name)]


def find_occluders(given):
    """The file that was named, or that of the capture folder; "" if there is none."""
    usual = Path(given["capture"]) / OCCLUDERS
    return given["occluders"] or (str(usual) if given["capture"] and usual.is_file() else "")


def node(executable, name, parameters, respawn):
    """One process; empty lists are left out, as ROS cannot tell their type."""
    filled = {key: value for key, value in parameters.items() if value != []}
    return Node(
        package="panoptic_ros",
        executable=executable,
        name=name,
        output="screen",
        parameters=[filled],
        respawn=respawn,
        respawn_delay=2.0,
    )
