"""`panoptic run`: compute 3D poses from cameras, videos, a capture folder or a bag."""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from panoptic_ros.cli.offsets import add_apart_option, add_saved_option
from panoptic_ros.cli.options import add_occluder_option, add_parameter_options, names, program_shown
from panoptic_ros.cli.run.usage import check_usage
from panoptic_ros.io.output import lossy_output
from panoptic_ros.io.skeletons import DEFAULT_SKELETON
from panoptic_ros.running.arguments import within

if TYPE_CHECKING:
    from panoptic_ros.running.processes.children import LaunchPreparation


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the verb."""
    parser.add_argument(
        "capture", nargs="?", type=Path, metavar="CAPTURE_DIR", help="capture folder to process"
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for the results")
    parser.add_argument("--demo", nargs="?", const="multi", help="process the demo capture: multi or single")
    parser.add_argument(
        "--bag",
        action="append",
        default=[],
        type=Path,
        help="rosbag2 with detections or images; repeatable",
    )
    parser.add_argument(
        "--topic",
        action="append",
        default=[],
        metavar="CAMERA=TOPIC",
        help="with --bag: topic of a camera, if its name does not contain the camera; repeatable",
    )
    parser.add_argument(
        "--depth-topic",
        action="append",
        default=[],
        metavar="CAMERA=TOPIC",
        help="with --bag: topic of a camera's depth maps; repeatable",
    )
    parser.add_argument(
        "--encoding",
        action="append",
        default=[],
        metavar="[CAMERA=]ENCODING",
        help="with --bag: encoding of the images, instead of the one in the messages, e.g. yuyv; repeatable",
    )
    parser.add_argument(
        "--arrival-stamps",
        action="store_true",
        help="with --bag: use the times of recording instead of the timestamps in headers",
    )
    parser.add_argument(
        "--redetect",
        action="store_true",
        help="with --bag: run detection on the images, and ignore recorded detections",
    )
    parser.add_argument("--rig", type=Path, help="calibration, instead of the capture's own")
    add_occluder_option(parser)
    parser.add_argument(
        "--video",
        action="append",
        default=[],
        metavar="CAMERA=FILE",
        help="video or folder of images of a camera; repeatable",
    )
    parser.add_argument(
        "--device",
        action="append",
        default=[],
        metavar="CAMERA=DEVICE",
        help="V4L2 device or RTSP/HTTP address of a camera; repeatable",
    )
    parser.add_argument(
        "--topics",
        type=Path,
        metavar="FILE",
        help="topics of running drivers: {camera: {image, camera_info, depth, encoding}}. Without --rig, "
        "camera poses come from TF",
    )
    parser.add_argument(
        "--imus",
        action="store_true",
        help="live, without cameras: solve bodies of --subject from /<device>/imu alone",
    )
    parser.add_argument(
        "--fixed-frame",
        default="",
        metavar="FRAME",
        help="with --topics and without --rig: TF frame that is the world",
    )
    parser.add_argument(
        "--microphone",
        action="append",
        default=[],
        metavar="NAME=DEVICE",
        help="with --device: sound input with timecode, by its PortAudio name, e.g. mic=hw:1, or a WAV "
        "file to play; repeatable",
    )
    parser.add_argument(
        "--latency-ms",
        type=within(float, 0, 60_000),
        default=0.0,
        metavar="MS",
        help="latency of the devices, from exposure to arrival",
    )
    parser.add_argument(
        "--subject",
        action="append",
        default=[],
        type=Path,
        metavar="FILE",
        help="file of a designated person; repeatable. All others are bystanders and left out. "
        "subject*.json files of a capture folder are included",
    )
    parser.add_argument("--cameras", help="use only these cameras, names separated by commas")
    parser.add_argument(
        "--frame-rate",
        type=within(float, 0.01, 10_000),
        metavar="HZ",
        help="frame rate, instead of the files' own; for devices, default 30",
    )
    parser.add_argument(
        "--size-policy",
        choices=("strict", "scale", "letterbox", "crop"),
        default="strict",
        help="images of another size than calibrated: refuse them (strict), or fit them in this way",
    )
    parser.add_argument(
        "--hardware",
        default="",
        metavar="KIND",
        help="decoder of videos instead of the processor: cuda, qsv, ...",
    )
    parser.add_argument(
        "--skip-damaged",
        action="store_true",
        help="leave out damaged frames and count them, instead of an error",
    )
    parser.add_argument("--model", help="pose model: name, card or ONNX file (as --set detection.model=)")
    parser.add_argument(
        "--skeleton",
        default="",
        help=f"working skeleton: name or YAML file; default: the preset's, or {DEFAULT_SKELETON}",
    )
    parser.add_argument(
        "--in-process", action="store_true", help="run all stages in one process, without ROS"
    )
    parser.add_argument(
        "--offline",
        action="store_true",
        help="recordings: refine skeletons over the whole recording, in both directions of time (in one "
        "process; with --preset patches by the motion of the surface)",
    )
    parser.add_argument(
        "--node-per-stage",
        action="store_true",
        help="live: run every stage after detection in a node and process of its own too",
    )
    parser.add_argument(
        "--jpeg",
        type=within(int, 0, 100),
        default=0,
        metavar="QUALITY",
        help="send images as JPEG of this quality (1-100); 0: unchanged",
    )
    parser.add_argument(
        "--publish",
        default="",
        metavar="WORDS",
        help="publish skeletons in other formats too, separated by commas: roots (PoseArray), tf (of "
        "joints), bodies (REP 155), boxes (Detection3DArray); of --subject joints (JointState, URDF), "
        "segments (TF), stream (WebSocket); also heat_maps",
    )
    parser.add_argument(
        "--namespace",
        default="",
        metavar="NAME",
        help="namespace of nodes and topics, to run several graphs side by side",
    )
    parser.add_argument("--live-view", action="store_true", help="show a table during the run")
    parser.add_argument("--no-pictures", action="store_true", help="write no overlays, video and plot")
    parser.add_argument(
        "--duration",
        type=within(float, 0.1, 1e9),
        metavar="S",
        help="recording: use only its first seconds, by timestamps. Live: stop this time after the first "
        "image",
    )
    add_saved_option(parser)
    parser.add_argument(
        "--offsets-from-sound",
        action="store_true",
        help="estimate the cameras' clocks from their sound, and correct timestamps",
    )
    add_apart_option(parser)
    parser.add_argument(
        "--repair",
        action="store_true",
        help="correct cameras that turn or zoom during the run; the corrected rig is in rig_repaired.json",
    )
    add_parameter_options(parser)


def run(args: argparse.Namespace) -> int:
    """Run to the end, write the results, and print the report."""
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    check_usage(args, parser.parse_args(["--out", ""]))
    from panoptic_ros.cli.run.beginning import begun  # imported here to keep --help fast

    with lossy_output(), begun(args) as ahead:
        return _run(args, ahead)


def _run(args: argparse.Namespace, ahead: LaunchPreparation) -> int:
    from panoptic_ros.cli.run.source import make_plan
    from panoptic_ros.cli.run.watch import TerminalObserver
    from panoptic_ros.running.runs.run import run as run_plan
    from panoptic_ros.running.takes import named_unclosed_takes

    plan = replace(make_plan(args), publish=tuple(names(args.publish) or ()), namespace=args.namespace)
    with TerminalObserver(args.live_view) as watch:
        outcome = run_plan(
            plan,
            args.out,
            in_process=args.in_process,
            offline=args.offline,
            jpeg_quality=args.jpeg,
            node_per_stage=args.node_per_stage,
            duration_s=args.duration,
            pictures=not args.no_pictures,
            observer=watch,
            ahead=ahead,
        )
    if outcome.report is not None:
        print(outcome.report.table())
    for line in outcome.troubles:
        print(f"\nwarning: {line}", file=sys.stderr)
    print(f"\nresults in {args.out}: {', '.join(outcome.files)}")
    print(f"see them: {program_shown()} view {args.out}")
    if outcome.fault is not None:
        raise outcome.fault
    for line in () if plan.live else named_unclosed_takes():
        print(f"warning: {line}", file=sys.stderr)
    return 0
