"""What a run consists of: cameras, where their data come from, skeleton, parameters."""
from __future__ import annotations

import argparse
import os
from collections.abc import Mapping
from contextlib import closing
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

from panoptic_ros.capture import demo_capture, open_capture_folder, open_files
from panoptic_ros.cli.options import read_parameters, with_defaults, with_occluders
from panoptic_ros.domain import Rig, SkeletonModel
from panoptic_ros.errors import CalibrationError, DataError, UsageError
from panoptic_ros.graph.build import configure
from panoptic_ros.graph.topics import TOPICS, check_names
from panoptic_ros.io.bags import BagReader
from panoptic_ros.io.detector_context import bias_extras, detector_extras
from panoptic_ros.io.messages import from_message
from panoptic_ros.io.rigs import read_rig
from panoptic_ros.io.skeletons import DEFAULT_SKELETON
from panoptic_ros.params import Config


@dataclass(frozen=True)
class Plan:
    """A run, before anything has started.

    Args:
        sources: of each camera, as `nodes.sources` takes them; empty for a bag.
        bag: the bag, and the topics to replay by camera.
        depth_cameras: whose images come with depth maps; depth_topics: of the bag, by camera.
        stage: the first stage that is needed, detection or sync.
        extras: what detection and assembly need besides; empty if nothing.
        frame_count: of all cameras together, None if not known; instants: of the longest camera.
        live: devices, in place of recordings.
        notices: one line each about what was adapted.
    """

    title: str
    rig: Rig
    skeleton: SkeletonModel
    configs: Mapping[str, Config]
    sources: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    bag: Path | None = None
    bag_topics: Mapping[str, str] = field(default_factory=dict)
    depth_cameras: tuple[str, ...] = ()
    depth_topics: Mapping[str, str] = field(default_factory=dict)
    stage: str = "detection"
    extras: Mapping[str, Any] = field(default_factory=dict)
    frame_count: int | None = None
    instants: int | None = None
    frame_rate: float = 30.0
    live: bool = False
    notices: tuple[str, ...] = ()


def make_plan(args: argparse.Namespace) -> Plan:
    """The plan that the command line asks for.

    Raises:
        UserError: on whatever the user can mend, before anything has started.
    """
    parameters = read_parameters(args)
    if args.model:
        parameters.setdefault("detection", {})["model"] = args.model
    if args.bag:
        plan = _bag_plan(args, parameters)
    else:
        skeleton, extras = _detector(args, parameters)
        kind = _device_plan if args.device else _recorded_plan
        plan = kind(args, parameters, skeleton, extras)
    check_names(plan.rig.names)
    table = plan.configs["assembly"].bias_table  # type: ignore[attr-defined]
    rig = with_occluders(plan.rig, args.occluders)
    return replace(plan, rig=rig, extras={**plan.extras, **bias_extras(table, plan.skeleton)})


def _detector(
    args: argparse.Namespace, parameters: Mapping[str, Mapping[str, Any]]
) -> tuple[SkeletonModel, Mapping[str, Any]]:
    config = configure(parameters)["detection"]
    return detector_extras(config.model, args.skeleton)  # type: ignore[attr-defined]


def _recorded_plan(
    args: argparse.Namespace, parameters: dict[str, Any], skeleton: SkeletonModel, extras: Mapping[str, Any]
) -> Plan:
    cameras = args.cameras.split(",") if args.cameras else None
    options = {"size_policy": args.size_policy, "frame_rate": args.frame_rate}
    rig = read_rig(args.rig) if args.rig else None
    if args.video:
        if rig is None:
            raise UsageError("--video needs --rig, the calibration of the cameras")
        files = _pairs(args.video, "--video")
        capture = open_files(rig, {name: Path(path) for name, path in files.items()}, **options)
        sources = {name: {"kind": "file", "path": path, **options} for name, path in files.items()}
        title = "videos"
    else:
        folder = Path(demo_capture(args.demo) if args.demo else args.capture)
        capture = open_capture_folder(folder, rig=rig, cameras=cameras, **options)
        where = {"kind": "folder", "path": str(folder), **options}
        sources = dict.fromkeys(capture.rig.names, where)
        title = f"demo capture {args.demo}" if args.demo else str(folder)
    with closing(capture):
        _enough(capture.rig)
        rate = max(source.frame_rate for source in capture.sources)
        counts = [source.frame_count for source in capture.sources]
        instants = None if None in counts else max(count for count in counts if count is not None)
        return Plan(
            title, capture.rig, skeleton,
            with_defaults(parameters, _rate_defaults(rate)), sources, extras=extras,
            depth_cameras=capture.depth_cameras, frame_count=capture.frame_count, instants=instants,
            frame_rate=rate, notices=capture.notices,
        )  # fmt: skip


def _device_plan(
    args: argparse.Namespace, parameters: dict[str, Any], skeleton: SkeletonModel, extras: Mapping[str, Any]
) -> Plan:
    if not args.rig:
        raise UsageError("--device needs --rig, the calibration of the cameras")
    devices = _pairs(args.device, "--device")
    rig = read_rig(args.rig).subset(devices)
    _enough(rig)
    rate = args.frame_rate or 30.0
    options = {"frame_rate": args.frame_rate, "latency_ms": args.latency_ms}
    defaults = _rate_defaults(rate)
    defaults["sync"]["deadline_s"] = max(0.5, 3.0 / rate)  # detection works through the cameras in turn
    defaults["detection"] = {"threads": max(1, (os.cpu_count() or 2) // 2)}
    return Plan(
        "cameras", rig, skeleton, with_defaults(parameters, defaults),
        {name: {"kind": "device", "device": device, **options} for name, device in devices.items()},
        extras=extras, frame_rate=rate, live=True,
    )  # fmt: skip


def _bag_plan(args: argparse.Namespace, parameters: dict[str, Any]) -> Plan:
    """Detections of the bag if it has them, else its images."""
    with BagReader(args.bag) as bag:
        rig = read_rig(args.rig) if args.rig else _from_bag(bag, "rig")
        if args.cameras:
            rig = rig.subset(args.cameras.split(","))
        found = {key: _camera_topics(bag, rig, key) for key in ("detections", "image", "compressed_image")}
        instants = max((bag.counts[t] for topics in found.values() for t in topics), default=0)
        rate = _rate_of(bag, next((t for topics in found.values() for t in topics), None))
        configs = with_defaults(parameters, _rate_defaults(rate))
        if found["detections"] and not args.redetect:
            _refuse_detector_options(args)
            skeleton, extras, chosen, stage = _from_bag(bag, "skeleton_model"), {}, "detections", "sync"
            depths = {}  # the detections know
        else:
            chosen = "image" if found["image"] else "compressed_image"
            if not found[chosen]:
                wanted = ", ".join(TOPICS[key].name for key in found)
                raise DataError(
                    f"{args.bag} has none of the topics {wanted} for the cameras {', '.join(rig.names)}; "
                    f"it has {', '.join(sorted(bag.topics)) or 'no topics'}"
                )
            skeleton, extras = _detector(args, parameters)
            stage, depths = "detection", _camera_topics(bag, rig, "depth")
    there = set(found[chosen].values())
    absent = [name for name in rig.names if name not in there]
    rig = rig.subset(there)
    _enough(rig)
    return Plan(
        f"bag {args.bag}", rig, skeleton, configs, bag=Path(args.bag),
        bag_topics=found[chosen], depth_cameras=tuple(depths.values()), depth_topics=depths,
        stage=stage, extras=extras,
        frame_count=instants * len(found[chosen]), instants=instants, frame_rate=rate,
        notices=tuple(f"camera {name} of the rig is not in the bag" for name in absent),
    )  # fmt: skip


def _refuse_detector_options(args: argparse.Namespace) -> None:
    if args.model or args.skeleton != DEFAULT_SKELETON:
        option = "--model" if args.model else "--skeleton"
        raise UsageError(
            f"{option} has no meaning for the detections in {args.bag}, which are used as they are; add "
            "--redetect if it has images"
        )


def _camera_topics(bag: BagReader, rig: Rig, key: str) -> dict[str, str]:
    """Topic in the bag -> camera."""
    names = {"/" + TOPICS[key].of(name): name for name in rig.names}
    return {topic: names[topic] for topic in bag.topics if topic in names}


def _from_bag(bag: BagReader, key: str) -> Any:
    topic = "/" + TOPICS[key].name
    for _, _, message in bag.messages(topic) if topic in bag.topics else ():
        return from_message(message, TOPICS[key].record)
    remedy = "; give the calibration with --rig" if key == "rig" else "; use --redetect if it has images"
    raise DataError(f"{bag.path} has no message on {topic}{remedy}")


def _rate_of(bag: BagReader, topic: str | None) -> float:
    """Frames per second on a topic, from its first messages."""
    stamps = []
    for _, _, message in bag.messages(topic) if topic else ():
        stamps.append(message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec)
        if len(stamps) == 20:
            break
    steps = sorted(b - a for a, b in pairwise(stamps) if b > a)
    return 1e9 / steps[len(steps) // 2] if steps else 30.0


def _rate_defaults(rate: float) -> dict[str, dict[str, Any]]:
    """Parameters that follow from the fastest camera's frame rate: none, as sync measures rates itself."""
    return {"sync": {}}


def _pairs(texts: list[str], option: str) -> dict[str, str]:
    pairs: dict[str, str] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not (name and equals and value):
            raise UsageError(f"{option} {text!r}: write CAMERA=..., e.g. {option} cam01=left.mp4")
        if name in pairs:
            raise UsageError(f"{option} names the camera {name!r} twice")
        pairs[name] = value
    return pairs


def _enough(rig: Rig) -> None:
    if len(rig) < 2:
        raise CalibrationError(f"{len(rig)} camera ({', '.join(rig.names)}) is not enough for 3D")
