"""`panoptic sync`: what the clocks of a capture do, and how its frames belong together."""

from __future__ import annotations

import argparse
import importlib
from types import ModuleType

ACTIONS: dict[str, str] = {
    "report": "offset, drift, jitter and drops per device, what is wrong and what to do",
    "sound": "offset and drift per camera from what their microphones hear, without timecode",
    "kinects": "Panoptic Studio: the Kinect frames that belong to HD frames, from sync tables",
}  # each is a module of this folder with add_arguments(parser) and run(args)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the verb's actions."""
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    for name, text in ACTIONS.items():
        sub = actions.add_parser(name, help=text, description=text[0].upper() + text[1:] + ".")
        _module(name).add_arguments(sub)


def run(args: argparse.Namespace) -> int:
    """Run the chosen action."""
    return int(_module(args.action).run(args))


def _module(action: str) -> ModuleType:
    return importlib.import_module(f"panoptic_ros.cli.sync.{action}")
