"""`panoptic watch`: show the state of a live graph from another shell."""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import time

from panoptic_ros.io.interruption import first_request_told
from panoptic_ros.running.processes.shared_memory import prepare_shared_memory
from panoptic_ros.view.watch_table import watch_lines

HOME, REST, CLEAR = "\x1b[H", "\x1b[K", "\x1b[J"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the verb."""
    parser.add_argument(
        "--namespace", metavar="NAME", help="namespace of one graph; default: all graphs in this ROS domain"
    )
    parser.add_argument("--once", action="store_true", help="print the current state and exit")
    parser.add_argument("--json", action="store_true", help="print one JSON document per update")
    parser.add_argument(
        "--period", type=float, default=1.0, metavar="S", help="seconds between updates; default 1"
    )


def run(args: argparse.Namespace) -> int:
    """Show the state until interrupted, or once."""
    prepare_shared_memory()  # must precede the import of ROS
    from panoptic_ros.running.watching import watched  # needs ROS

    drawn = sys.stdout.isatty() and not args.once and not args.json
    with first_request_told(True) as asked:
        for told in watched(args.namespace, max(0.1, args.period), asked):
            if args.json:
                rows = [
                    {"namespace": t.namespace, "name": t.name, "trouble": t.trouble, **t.values} for t in told
                ]
                print(json.dumps(rows), flush=True)
            else:
                lines = watch_lines(told, time.monotonic())
                print(_screen(lines) if drawn else "\n".join(lines), flush=True)
            if args.once:
                break
    return 0


def _screen(lines: list[str]) -> str:
    """Return the lines with terminal codes that draw them from the top, cut to the terminal's size."""
    width, height = shutil.get_terminal_size()
    return HOME + "\n".join(line[:width] + REST for line in lines[: height - 1]) + CLEAR
