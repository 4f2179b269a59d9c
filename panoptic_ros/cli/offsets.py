"""Options for camera clocks, shared by the verbs that solve recorded captures."""

from __future__ import annotations

import argparse
from pathlib import Path

from panoptic_ros.running.arguments import output_file, within


def add_saved_option(parser: argparse.ArgumentParser) -> None:
    """Add the option for saved clocks."""
    parser.add_argument(
        "--offsets",
        type=Path,
        metavar="FILE",
        help="saved clocks and line delays, from --offsets-out, --clocks-out or a run (see docs/time.md)",
    )


def add_apart_option(parser: argparse.ArgumentParser) -> None:
    """Add the option for the largest distance between microphones."""
    parser.add_argument(
        "--apart",
        type=within(float, 0.0, 1000.0),
        default=6.0,
        metavar="M",
        help="greatest distance between microphones if no calibration states it (default 6)",
    )


def add_offset_options(parser: argparse.ArgumentParser) -> None:
    """Add the clock options of a verb that solves a recording."""
    add_saved_option(parser)
    parser.add_argument(
        "--offsets-from-motion",
        action="store_true",
        help="estimate the cameras' clock offsets and drifts from the motion of people, and correct the "
        "timestamps",
    )
    parser.add_argument(
        "--offsets-from-sound",
        type=Path,
        metavar="DIR",
        help="estimate offsets from the cameras' sound, in a capture folder or bag with recordings; "
        "--offsets-from-motion then starts from them",
    )
    add_apart_option(parser)
    parser.add_argument(
        "--offsets-out",
        type=output_file,
        metavar="FILE",
        help="file for the offsets, with standard deviations, as JSON",
    )
    parser.add_argument(
        "--trusted-camera",
        default="",
        metavar="NAME",
        help="camera with right timestamps; default: those of most cameras if they agree, else offsets "
        "have mean 0",
    )
