"""Build the plan of a run from the command line."""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path

from panoptic_ros.cli.options import names, pairs
from panoptic_ros.errors import UsageError
from panoptic_ros.io.skeletons import DEFAULT_SKELETON
from panoptic_ros.running.plans.bag_plan import plan_bags
from panoptic_ros.running.plans.bag_topics import BagChoice
from panoptic_ros.running.plans.imu_plan import plan_live_imus
from panoptic_ros.running.plans.options import RunOptions, Source
from panoptic_ros.running.plans.parameters import read_parameters
from panoptic_ros.running.plans.plan import Plan
from panoptic_ros.running.plans.planning import plan_capture, plan_demo, plan_devices, plan_videos
from panoptic_ros.running.plans.presets import read_preset


def make_plan(args: argparse.Namespace) -> Plan:
    """Return the plan for the command line, whose usage has been checked.

    Raises:
        UserError: on any error that the user can correct, before anything has started.
    """
    preset = read_preset(args.preset)
    settings = [*args.settings, *(["health.repair=true"] if args.repair else [])]
    options = RunOptions(
        read_parameters(args.config, settings, preset.parameters),
        args.model or "",
        args.skeleton,
        preset.skeleton or DEFAULT_SKELETON,
        args.occluders,
        args.offsets,
        args.offsets_from_sound,
        args.apart,
        tuple(args.subject),
    )
    return _source(args)(options)


def _source(args: argparse.Namespace) -> Source:
    """Return the planning function for the source of records that the command line names."""
    if args.bag:
        own = {"rig": args.rig, "choice": _choice(args), "size_policy": args.size_policy}
        return partial(plan_bags, args.bag, **own)
    if args.topics:
        from panoptic_ros.running.plans.driver_plan import plan_drivers  # needs ROS

        return partial(plan_drivers, args.topics, rig=args.rig, fixed_frame=args.fixed_frame)
    if args.imus:
        return plan_live_imus
    if args.device:
        own = {"frame_rate": args.frame_rate, "latency_ms": args.latency_ms}
        own |= {"microphones": pairs(args.microphone, "--microphone")}
        return partial(plan_devices, args.rig, pairs(args.device, "--device"), **own)
    own = {name: getattr(args, name) for name in ("frame_rate", "size_policy", "hardware", "skip_damaged")}
    if args.video:
        files = {name: Path(path) for name, path in pairs(args.video, "--video").items()}
        return partial(plan_videos, args.rig, files, **own)
    own |= {"rig": args.rig, "cameras": names(args.cameras)}
    return partial(plan_demo, args.demo, **own) if args.demo else partial(plan_capture, args.capture, **own)


def _choice(args: argparse.Namespace) -> BagChoice:
    return BagChoice(
        names(args.cameras),
        pairs(args.topic, "--topic"),
        pairs(args.depth_topic, "--depth-topic"),
        args.arrival_stamps,
        args.redetect,
        _encodings(args.encoding),
    )


def _encodings(texts: list[str]) -> dict[str, str]:
    """Parse encodings by camera; one without a camera applies to all other cameras, under the key ""."""
    for_all = [text for text in texts if "=" not in text]
    if len(for_all) > 1:
        raise UsageError(f"--encoding gives {' and '.join(for_all)} for all cameras; write CAMERA=ENCODING")
    named = pairs([text for text in texts if "=" in text], "--encoding")
    return named | ({"": for_all[0]} if for_all else {})
