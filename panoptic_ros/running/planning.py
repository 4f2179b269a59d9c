"""The plan of a run, from the command line."""
from __future__ import annotations

import argparse
import os
from collections.abc import Mapping
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

from panoptic_ros.capture import demo_capture, open_capture_folder, open_files
from panoptic_ros.domain import SkeletonModel
from panoptic_ros.errors import UsageError
from panoptic_ros.graph.build import configure
from panoptic_ros.graph.flow import LIVE_DEFAULTS
from panoptic_ros.graph.topics import check_names
from panoptic_ros.io.detector_context import bias_extras
from panoptic_ros.io.rigs import read_rig
from panoptic_ros.running.bag_plan import bag_plan
from panoptic_ros.running.parameters import read_parameters, with_defaults, with_occluders
from panoptic_ros.running.plan import Plan, find_detector, pairs, require_two
from panoptic_ros.running.saved_offsets import saved_lines, saved_offsets


def make_plan(args: argparse.Namespace) -> Plan:
    """The plan that the command line asks for.

    Raises:
        UserError: on whatever the user can mend, before anything has started.
    """
    parameters = read_parameters(args.config, args.settings)
    if args.model:
        parameters.setdefault("detection", {})["model"] = args.model
    if args.bag:
        plan = bag_plan(args, parameters)
    else:
        skeleton, extras = find_detector(parameters, args.skeleton)
        kind = _device_plan if args.device else _recorded_plan
        plan = kind(args, parameters, skeleton, extras)
    check_names(plan.rig.names)
    table = plan.configs["assembly"].bias_table  # type: ignore[attr-defined]
    rig = with_occluders(plan.rig, args.occluders)
    plan = _with_offsets(plan, args.offsets)
    return replace(plan, rig=rig, extras={**plan.extras, **bias_extras(table, plan.skeleton)})


def _with_offsets(plan: Plan, path: Path | None) -> Plan:
    """The plan with offsets that were found before as delays of the cameras."""
    if path is None:
        return plan
    sync, offsets = plan.configs["sync"], plan.configs["offsets"]
    if sync.delays_ms:  # type: ignore[attr-defined]
        raise UsageError("--offsets and sync.delays_ms both tell how late stamps are; give one of them")
    saved = saved_offsets(path, plan.rig.names)
    delays = tuple(f"{name}={1e3 * offset.offset_s:.4f}" for name, offset in saved.items())
    configs = {
        **plan.configs, "sync": replace(sync, delays_ms=delays), "offsets": replace(offsets, delays_ms=delays)
    }  # fmt: skip
    told = tuple(line.strip() for line in saved_lines(saved, plan.rig.names))
    return replace(plan, configs=configs, notices=(*plan.notices, *told))


def _recorded_plan(
    args: argparse.Namespace, parameters: dict[str, Any], skeleton: SkeletonModel, extras: Mapping[str, Any]
) -> Plan:
    cameras = args.cameras.split(",") if args.cameras else None
    options = {"size_policy": args.size_policy, "frame_rate": args.frame_rate}
    rig = read_rig(args.rig) if args.rig else None
    if args.video:
        if rig is None:
            raise UsageError("--video needs --rig, the calibration of the cameras")
        files = pairs(args.video, "--video")
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
        require_two(capture.rig)
        rate = max(source.frame_rate for source in capture.sources)
        counts = [source.frame_count for source in capture.sources]
        instants = None if None in counts else max(count for count in counts if count is not None)
        return Plan(
            title, capture.rig, skeleton,
            configure(parameters), sources, extras=extras,
            depth_cameras=capture.depth_cameras, frame_count=capture.frame_count, instants=instants,
            frame_rate=rate, notices=capture.notices,
        )  # fmt: skip


def _device_plan(
    args: argparse.Namespace, parameters: dict[str, Any], skeleton: SkeletonModel, extras: Mapping[str, Any]
) -> Plan:
    if not args.rig:
        raise UsageError("--device needs --rig, the calibration of the cameras")
    devices = pairs(args.device, "--device")
    rig = read_rig(args.rig).subset(devices)
    require_two(rig)
    rate = args.frame_rate or 30.0
    options = {"frame_rate": args.frame_rate, "latency_ms": args.latency_ms}
    defaults = {
        # detection works through the cameras in turn
        "sync": {"deadline_s": max(LIVE_DEFAULTS["sync"]["deadline_s"], 3.0 / rate)},
        "detection": {"threads": max(1, (os.cpu_count() or 2) // 2)},
    }
    return Plan(
        "cameras", rig, skeleton, with_defaults(parameters, defaults),
        {name: {"kind": "device", "device": device, **options} for name, device in devices.items()},
        extras=extras, frame_rate=rate, live=True,
    )  # fmt: skip
