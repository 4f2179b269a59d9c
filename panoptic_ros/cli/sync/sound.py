"""`panoptic sync sound`: the clocks of cameras from what their microphones hear."""

from __future__ import annotations

import argparse
from pathlib import Path

from panoptic_ros.cli.offsets import add_apart_option
from panoptic_ros.cli.options import output_file
from panoptic_ros.io.clock_offsets import write_clocks
from panoptic_ros.view.clock_lines import pair_lines, sound_lines
from panoptic_ros.view.progress import PassBar


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the action."""
    parser.add_argument(
        "source",
        type=Path,
        metavar="BAG|CAPTURE_DIR",
        help="a capture folder with WAV files or videos with sound, or a bag",
    )
    parser.add_argument("--rig", type=Path, help="where cameras are, in place of the folder's calibration")
    parser.add_argument(
        "--out", type=output_file, metavar="FILE", help="write the offsets as JSON, for --offsets"
    )
    parser.add_argument(
        "--trusted-camera",
        default="",
        metavar="NAME",
        help="its stamps are right; default: those of most cameras if they agree, else of "
        "the one that is farthest ahead",
    )
    add_apart_option(parser)


def run(args: argparse.Namespace) -> int:
    """Exit code 2 if the clock of a camera is not known."""
    from panoptic_ros.running.sound.clocks import folder_clocks  # only now: --help must be quick

    with PassBar("clocks from sound") as bar:
        found = folder_clocks(
            args.source, args.rig, trusted=args.trusted_camera, apart=args.apart, progress=bar.show
        )
    print("\n".join([*sound_lines(found), *pair_lines(found)]))
    if args.out is not None:
        write_clocks(args.out, found.clocks)
    return 0 if found.clocks.known.all() else 2
