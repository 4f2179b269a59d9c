"""The whole graph in a native Jazzy workspace: the nodes and processes that `panoptic run` starts.

    ros2 launch panoptic_ros panoptic.launch.py capture:=/path/to/capture
    ros2 launch panoptic_ros panoptic.launch.py rig:=rig.json devices:="left=/dev/video0 right=/dev/video2"

Where ROS comes from the wheels there is no launch system: `panoptic run` starts the same nodes.
"""

import atexit
import json
import os
import shutil
import tempfile
from dataclasses import replace
from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess, OpaqueFunction, SetEnvironmentVariable
from launch_ros.actions import Node

from panoptic_ros.detection.config import DetectionConfig
from panoptic_ros.errors import UsageError
from panoptic_ros.io.occluders import FILE as OCCLUDERS
from panoptic_ros.io.skeletons import DEFAULT_SKELETON
from panoptic_ros.params import config_of
from panoptic_ros.running.plans.options import RunOptions
from panoptic_ros.running.plans.parameters import read_parameters
from panoptic_ros.running.plans.planning import plan_capture, plan_devices
from panoptic_ros.running.plans.presets import read_preset
from panoptic_ros.running.processes.children import HOST, profile_path
from panoptic_ros.running.runs.launch import flow_of, without_patch_inputs, write_launch_file

ARGUMENTS = {
    "capture": ("", "capture folder: a rig file, and a video or a folder of images per camera"),
    "rig": ("", "calibration file; default: the one in the capture folder"),
    "occluders": ("", "fixed objects that hide people; default: occluders.json of the capture folder"),
    "devices": ("", "instead of a capture folder: camera=device or camera=URL, separated by spaces"),
    "microphones": ("", "with devices: name=device with timecode, separated by spaces"),
    "audio": ("", "with devices: names of devices with sound that other nodes publish, separated by spaces"),
    "subjects": ("", "files of designated people, separated by spaces"),
    "skeleton": ("", f"skeleton model; default: the preset's, or {DEFAULT_SKELETON}"),
    "model": ("", "pose model: the name of a card, or a file; default: that of the parameters"),
    "preset": ("", "set of parameters, by its name or a YAML file"),
    "config": ("", "YAML file of parameters, {stage: {name: value}}"),
    "publish": ("", "other formats of skeletons to publish, separated by commas, as of `panoptic run`"),
    "namespace": ("", "namespace of nodes and topics"),
    "flow": ("", "live (newest first) or replay (nothing is lost); default: replay for a capture folder"),
    "jpeg_quality": ("90", "JPEG quality of the images on the topics"),
    "node_per_stage": ("false", "true: live, a node and process of its own for every stage after detection"),
    "respawn": ("false", "true: a process that ends is restarted; for live use"),
}


def generate_launch_description():
    """Called by `ros2 launch`."""
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=text)
        for name, (default, text) in ARGUMENTS.items()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=start_graph)])


def start_graph(context):
    """The node of the rig, and the processes of the graph."""
    given = {name: context.launch_configurations[name] for name in ARGUMENTS}
    for name in ("respawn", "node_per_stage"):
        if given[name] not in ("true", "false"):
            raise UsageError(f"{name}:={given[name]}: true or false")
    anew = {"respawn": given["respawn"] == "true", "respawn_delay": 2.0, "output": "screen"}
    options = read_options(given)
    plan, _ = without_patch_inputs(make_plan(given, options))
    folder = Path(tempfile.mkdtemp(prefix="panoptic-launch-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    file = write_launch_file(
        plan, folder, *flow_of(plan), int(given["jpeg_quality"]), given["node_per_stage"] == "true"
    )
    fixed = folder / OCCLUDERS
    facts = {
        "rig": str(folder / "rig.json"),
        "occluders": str(fixed) if fixed.is_file() else "",
        "skeleton": options.chosen_skeleton,
        "model": config_of(plan.configs, DetectionConfig).model,
    }
    return [
        # room for images in shared memory
        SetEnvironmentVariable("FASTRTPS_DEFAULT_PROFILES_FILE", str(profile_path())),
        Node(
            package="panoptic_ros",
            executable="rig",
            name="rig",
            namespace=plan.namespace,
            parameters=[facts],
            **anew,
        ),
        *(
            ExecuteProcess(cmd=[*HOST, str(file), name, str(os.getpid())], name=name, **anew)
            for name in json.loads(file.read_text())["processes"]
        ),
    ]


def read_options(given):
    """What may be said about any run."""
    preset = read_preset(given["preset"])
    return RunOptions(
        read_parameters(Path(given["config"]) if given["config"] else None, (), preset.parameters),
        given["model"],
        given["skeleton"],
        preset.skeleton or DEFAULT_SKELETON,
        Path(given["occluders"]) if given["occluders"] else None,
        subjects=tuple(Path(name) for name in given["subjects"].split()),
    )


def make_plan(given, options):
    """The plan of `panoptic run` for the same cameras."""
    if bool(given["capture"]) == bool(given["devices"]):
        raise UsageError("give one of capture:=FOLDER and devices:='camera=device ...'")
    if given["devices"] and not given["rig"]:
        raise UsageError("devices:= needs rig:=FILE, the calibration of these cameras")
    if given["devices"] and given["flow"] == "replay":
        raise UsageError("flow:=replay is for recordings; leave it out for devices:=")
    rig = Path(given["rig"]) if given["rig"] else None
    if given["capture"]:
        plan = replace(plan_capture(Path(given["capture"]), options, rig=rig), live=given["flow"] == "live")
    else:
        microphones = pairs(given, "microphones")
        plan = plan_devices(rig, pairs(given, "devices"), options, microphones=microphones)
        plan = replace(plan, heard=tuple(given["audio"].split()))
    words = tuple(word for word in given["publish"].split(",") if word)
    return replace(plan, publish=words, namespace=given["namespace"])


def pairs(given, name):
    """{word: value} of "word=value word=value"."""
    found = [item.partition("=") for item in given[name].split()]
    for word, equals, _ in found:
        if not equals:
            raise UsageError(f"{name}:= has {word!r}; write name=device, separated by spaces")
    return {word: value for word, _, value in found}
