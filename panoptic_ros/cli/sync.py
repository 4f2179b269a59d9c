"""`panoptic sync`: report the clocks of a capture, and match its frames."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from panoptic_ros.cli.offsets import add_apart_option
from panoptic_ros.io.synctables import DEMO_BASE, HD_BASES, hd_time_ms, match_kinects, read_synctables
from panoptic_ros.running.arguments import output_file, output_folder
from panoptic_ros.view.clock_lines import pair_lines, sound_lines
from panoptic_ros.view.progress import PassBar
from panoptic_ros.view.sync_table import sync_table


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the verb's actions."""
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    for name, (text, add, _) in ACTIONS.items():
        sub = actions.add_parser(name, help=text, description=text[0].upper() + text[1:] + ".")
        add(sub)


def run(args: argparse.Namespace) -> int:
    """Run the chosen action."""
    return ACTIONS[args.action][2](args)


def _report_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `report`."""
    parser.add_argument(
        "source",
        type=Path,
        metavar="BAG|CAPTURE_DIR",
        help="a bag, a capture folder, or a file: timestamps.csv, sync tables, WAV or video with timecode",
    )
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    parser.add_argument(
        "--out", type=output_folder, metavar="DIR", help="folder for sync_report.json and sync.png"
    )


def _report(args: argparse.Namespace) -> int:
    """Report the clocks of a capture.

    Returns:
        the exit code: 2 if there is a warning, which the user can correct, else 0.
    """
    from panoptic_ros.running.sync_report.report import (  # imported here to keep --help fast
        report_clocks,
        write_report,
    )

    report = report_clocks(args.source)
    print(json.dumps(report.document, indent=1) if args.json else "\n".join(sync_table(report.document)))
    if args.out is not None:
        write_report(args.out, report)
    return 2 if report.warned else 0


def _sound_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `sound`."""
    parser.add_argument(
        "source",
        type=Path,
        metavar="BAG|CAPTURE_DIR",
        help="a capture folder with WAV files or videos with sound, or a bag",
    )
    parser.add_argument(
        "--rig", type=Path, help="calibration with the positions of the cameras, instead of the folder's own"
    )
    parser.add_argument(
        "--out", type=output_file, metavar="FILE", help="file for the offsets as JSON, for --offsets"
    )
    parser.add_argument(
        "--trusted-camera",
        default="",
        metavar="NAME",
        help="camera with right timestamps; default: those of most cameras if they agree, else those of "
        "the camera that is farthest ahead",
    )
    add_apart_option(parser)


def _sound(args: argparse.Namespace) -> int:
    """Estimate camera clocks from sound; return exit code 2 if a camera's clock remains unknown."""
    from panoptic_ros.io.clock_files import write_clocks  # imported here to keep --help fast
    from panoptic_ros.running.sound.clocks import folder_clocks

    with PassBar("clocks from sound") as bar:
        found = folder_clocks(
            args.source, args.rig, trusted=args.trusted_camera, apart=args.apart, progress=bar.show
        )
    print("\n".join([*sound_lines(found), *pair_lines(found)]))
    if args.out is not None:
        write_clocks(args.out, found.clocks, found.clocks.reference_ns)
    return 0 if found.clocks.known.all() else 2


def _kinects_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `kinects`."""
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
        help="HD image file, counted from 0; repeatable",
    )
    parser.add_argument(
        "--hd-base",
        type=int,
        default=DEMO_BASE,
        choices=HD_BASES,
        help="offset of elements of hd.univ_time: file N is element N + this. The value is disputed; 1 is "
        "that of CMU's demo (default)",
    )


def _kinects(args: argparse.Namespace) -> int:
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


ACTIONS = {
    "report": (
        "report offset, drift, jitter and drops per device, with faults and remedies",
        _report_arguments,
        _report,
    ),
    "sound": (
        "estimate offset and drift per camera from the sound of their microphones, without timecode",
        _sound_arguments,
        _sound,
    ),
    "kinects": (
        "find the Kinect frames of HD frames, from the sync tables of the Panoptic Studio",
        _kinects_arguments,
        _kinects,
    ),
}
