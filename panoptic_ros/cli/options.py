"""Options and parsers that several verbs share."""

from __future__ import annotations

import argparse
import os
import shutil
import sys
import webbrowser
from pathlib import Path

from panoptic_ros.errors import UsageError
from panoptic_ros.running.arguments import within

SCREENS = ("DISPLAY", "WAYLAND_DISPLAY")


def add_occluder_option(parser: argparse.ArgumentParser) -> None:
    """Add the option for occluders between cameras and people."""
    parser.add_argument(
        "--occluders",
        type=Path,
        metavar="FILE",
        help="fixed objects that hide people: occluders.json, PLY or OBJ",
    )


def program_shown() -> str:
    """Return the command that calls this program: its name if the shell finds it, else its path."""
    path = Path(sys.argv[0]).absolute()
    if shutil.which(path.name) == str(path):
        return path.name
    return str(path.relative_to(Path.cwd()) if path.is_relative_to(Path.cwd()) else path)


def add_parameter_options(parser: argparse.ArgumentParser) -> None:
    """Add --preset NAME, --config FILE and --set stage.name=value.

    --set overrides --config, which overrides --preset.
    """
    parser.add_argument(
        "--preset",
        metavar="NAME",
        default="",
        help="set of parameters: panoptic-studio (the paper's method), or a YAML file",
    )
    parser.add_argument(
        "--config",
        type=Path,
        metavar="FILE",
        help="YAML file of parameters, {stage: {name: value}}, or a ROS parameter file",
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="STAGE.NAME=VALUE",
        dest="settings",
        help="one parameter; repeatable (see docs/parameters.md)",
    )


def add_page_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of verbs that serve a page."""
    parser.add_argument(
        "--host",
        default="127.0.0.1",
        help="address on which to listen; 0.0.0.0 lets other machines open the page at the printed address",
    )
    parser.add_argument(
        "--port", type=within(int, 0, 65535), default=8765, help="port on which to listen; 0: any free port"
    )
    parser.add_argument("--no-browser", action="store_true", help="print the address only, open no browser")


def open_page(address: str, wanted: bool) -> None:
    """Print the address of a page, and open it in a browser if that is wanted and there is a screen."""
    print(f"open {address} in a browser; Ctrl-C ends it", flush=True)
    # without a screen, a text browser may take over the terminal
    if wanted and any(map(os.environ.get, SCREENS)):
        webbrowser.open(address)


def pairs(texts: list[str], option: str) -> dict[str, str]:
    """Parse an option that is given once per camera to {camera: value}.

    Raises:
        UsageError: if the form is wrong, or a camera is named twice.
    """
    found: dict[str, str] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not (name and equals and value):
            raise UsageError(f"{option} {text!r}: write CAMERA=..., e.g. {option} cam01=left.mp4")
        if name in found:
            raise UsageError(f"{option} names the camera {name!r} twice")
        found[name] = value
    return found


def names(text: str | None) -> list[str] | None:
    """Split names separated by commas; None for an empty text."""
    return text.split(",") if text else None
