"""Options for camera clocks, shared by the verbs that solve recorded captures."""

from __future__ import annotations

import argparse
from pathlib import Path

from panoptic_ros.running.arguments import output_file, within


def add_saved_option(parser: argparse.ArgumentParser) -> None:
    """Add the option for saved clock offsets."""
    parser.add_argument(
        "--offsets",
        type=Path,
        metavar="FILE",
        help="add these offsets, found before, to the stamps; for latencies that last (see docs/time.md)",
    )


def add_apart_option(parser: argparse.ArgumentParser) -> None:
    """Add the option for the largest distance between microphones."""
    parser.add_argument(
        "--apart",
        type=within(float, 0.0, 1000.0),
        default=6.0,
        metavar="M",
        help="how far apart microphones are at most, where no calibration tells (default 6)",
    )


def add_offset_options(parser: argparse.ArgumentParser) -> None:
    """Add the clock options of a verb that solves a recording."""
    add_saved_option(parser)
    parser.add_argument(
        "--offsets-from-motion",
        action="store_true",
        help="find the cameras' clock offsets and drifts from the motion of people, and correct the stamps",
    )
    parser.add_argument(
        "--offsets-from-sound",
        type=Path,
        metavar="DIR",
        help="find them from what cameras hear, of which a capture folder or bag has recordings; with "
        "--offsets-from-motion as its first guess",
    )
    add_apart_option(parser)
    parser.add_argument(
        "--offsets-out",
        type=output_file,
        metavar="FILE",
        help="write the offsets, with standard deviations, as JSON",
    )
    parser.add_argument(
        "--trusted-camera",
        default="",
        metavar="NAME",
        help="its stamps are right; default: those of most cameras if they agree, else offsets have mean 0",
    )
