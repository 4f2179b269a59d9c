"""Check that the options of `panoptic run` fit together. An option without an effect is refused."""

from __future__ import annotations

import argparse

from panoptic_ros.cli.options import names
from panoptic_ros.errors import UsageError

# see `nodes.listeners`: `people_node`, `heat_maps_node`
PUBLISHABLE = ("roots", "tf", "bodies", "boxes", "joints", "segments", "stream", "heat_maps")
_FILES = ("capture", "demo", "video")
_MEANS_SOMETHING_FOR = {
    "arrival_stamps": ("bag",),
    "depth_topic": ("bag",),
    "encoding": ("bag",),
    "cameras": ("capture", "demo", "bag"),
    "fixed_frame": ("topics",),
    "frame_rate": (*_FILES, "device"),
    "hardware": _FILES,
    "jpeg": (*_FILES, "device"),
    "latency_ms": ("device",),
    "microphone": ("device",),
    "offline": (*_FILES, "bag"),
    "offsets_from_sound": (*_FILES, "bag"),
    "apart": (*_FILES, "bag"),
    "node_per_stage": ("device", "topics", "imus"),
    "redetect": ("bag",),
    "size_policy": (*_FILES, "bag"),
    "skip_damaged": _FILES,
    "topic": ("bag",),
}
_SHOWN = {
    "capture": "a capture folder",
    **{name: f"--{name}" for name in ("bag", "video", "device", "topics", "imus", "demo")},
}


def check_usage(args: argparse.Namespace, defaults: argparse.Namespace) -> None:
    """Check that the arguments name exactly one source, and only options that it supports.

    Raises:
        UsageError: naming the option and the sources to which it applies.
    """
    given = [name for name in _SHOWN if getattr(args, name)]
    if len(given) != 1:
        raise UsageError(
            "give one of: a capture folder, --bag BAG, --rig R --video CAMERA=FILE ..., "
            "--rig R --device CAMERA=DEVICE ..., --topics FILE, --imus, --demo; found "
            f"{', '.join(given) or 'none'}"
        )
    for option, sources in _MEANS_SOMETHING_FOR.items():
        if getattr(args, option) != getattr(defaults, option) and given[0] not in sources:
            raise UsageError(
                f"--{option.replace('_', '-')} has no meaning with {_SHOWN[given[0]]}, only with "
                f"{', '.join(_SHOWN[name] for name in sources)}"
            )
    if given[0] in ("video", "device") and not args.rig:
        raise UsageError(f"--{given[0]} needs --rig, the calibration of the cameras")
    if args.imus and args.in_process:
        raise UsageError("--imus takes topics, so it has no meaning with --in-process")
    unknown = [word for word in names(args.publish) or () if word not in PUBLISHABLE]
    if unknown:
        raise UsageError(f"--publish {unknown[0]}: unknown format; there are {', '.join(PUBLISHABLE)}")
    for option in ("jpeg", "node_per_stage", "publish"):
        if getattr(args, option) and (args.in_process or args.offline):
            name, other = option.replace("_", "-"), "offline" if args.offline else "in-process"
            raise UsageError(f"--{name} has no meaning with --{other}, which starts no nodes")
