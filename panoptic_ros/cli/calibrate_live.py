"""`panoptic calibrate --live`: record a board with live cameras, with a guide."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from panoptic_ros.cli.options import HOST, PORT, add_page_options, names, open_page
from panoptic_ros.errors import UsageError
from panoptic_ros.running.processes.shared_memory import prepare_shared_memory

NOT_LIVE = ("people", "pattern", "floor", "depth_sensor")
# options without an effect on recordings, with their defaults
LIVE_ONLY = {"topics": None, "cameras": None, "host": HOST, "port": PORT, "no_browser": False}


def add_live_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of live cameras."""
    parser.add_argument(
        "--live",
        action="store_true",
        help="instead of FOLDER: record the board with live ROS cameras and say what to show next; Ctrl-C "
        "ends the recording, DIR/recording, and calibrates",
    )
    parser.add_argument(
        "--cameras",
        metavar="NAME,NAME",
        help="with --live: use only these cameras; default: all that publish",
    )
    parser.add_argument(
        "--topics", type=Path, metavar="FILE", help="with --live: topics of drivers, as of `panoptic run`"
    )
    add_page_options(parser)


def check_live_usage(args: argparse.Namespace) -> None:
    """Refuse options that do not fit together.

    Raises:
        UsageError: naming the option.
    """
    if not args.live:
        if args.folder is None:
            raise UsageError("give a folder or bag with images of the board, or --live")
        if wrong := [name for name, default in LIVE_ONLY.items() if getattr(args, name) != default]:
            raise UsageError(f"--{wrong[0].replace('_', '-')} is for --live")
        return
    if args.folder is not None:
        raise UsageError(f"{args.folder}: --live records from cameras; leave the folder or --live out")
    if wrong := [name for name in NOT_LIVE if getattr(args, name) not in (None, False, [])]:
        option = wrong[0].replace("_", "-")
        raise UsageError(f"--{option} is not for --live; calibrate DIR/recording with it afterwards")
    if args.board.startswith("wand:"):
        raise UsageError("--live needs a flat board; record a wand with `panoptic record`")
    if args.cameras and args.topics:
        raise UsageError("--topics names the cameras; leave --cameras out")


def record_live(args: argparse.Namespace, out: Path, board: Any) -> str:
    """Record until Ctrl-C; return the folder of the recording."""
    prepare_shared_memory()  # before the import of ROS, which terminates if shared memory is full
    from panoptic_ros.io.rigs.intrinsics import read_intrinsics
    from panoptic_ros.running.calibration.live import LiveOptions, LiveProgress, record_with_guide
    from panoptic_ros.view.guide_table import GuideTable

    known = read_intrinsics(args.intrinsics) if args.intrinsics else None
    chosen = names(args.cameras) or ()
    options = LiveOptions(args.lens, known, args.synchronous, chosen, args.topics, args.host, args.port)
    table = GuideTable()

    def show(progress: LiveProgress) -> None:
        table.show(*progress)

    def ready(address: str) -> None:
        open_page(address, not args.no_browser)

    folder = record_with_guide(out, board, options, show, ready, _tell)
    again = f" --lens {args.lens}" + (f" --intrinsics {args.intrinsics}" if args.intrinsics else "")
    again += " --synchronous" if args.synchronous else ""
    again = f"panoptic calibrate {folder} --board {args.board}{again} --out DIR"
    _tell(f"recorded {folder}; `{again}` reads it again")
    return str(folder)


def _tell(line: str) -> None:
    print(line, flush=True)
