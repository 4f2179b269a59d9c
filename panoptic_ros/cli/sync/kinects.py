"""`panoptic sync kinects`: frames of Panoptic Studio's Kinects that belong to HD frames."""

from __future__ import annotations

import argparse
from pathlib import Path

from panoptic_ros.io.synctables import DEMO_BASE, HD_BASES, hd_time_ms, match_kinects, read_synctables


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the action."""
    parser.add_argument(
        "tables",
        type=Path,
        nargs="+",
        metavar="TABLE.json",
        help="synctables_<sequence>.json and ksynctables_<sequence>.json",
    )
    parser.add_argument(
        "--frame",
        type=int,
        action="append",
        required=True,
        metavar="N",
        help="HD image file, counted from 0; may be given several times",
    )
    parser.add_argument(
        "--hd-base",
        type=int,
        default=DEMO_BASE,
        choices=HD_BASES,
        help="element of hd.univ_time for file N is N + this; contested, 1 is that of CMU's demo (default)",
    )


def run(args: argparse.Namespace) -> int:
    """Print one line per frame and Kinect."""
    streams = read_synctables(*args.tables)
    print(f"file N is element N + {args.hd_base} of hd.univ_time")
    print(f"{'frame':>6} {'ms':>12}  {'kinect':14} {'color':>6} {'depth':>6}")
    for frame in args.frame:
        time = hd_time_ms(streams, frame, args.hd_base)
        for node, match in match_kinects(streams, frame, args.hd_base).items():
            color, depth = ("-" if index is None else str(index) for index in (match.color, match.depth))
            print(f"{frame:6} {time:12.3f}  {node:14} {color:>6} {depth:>6}")
    return 0
