"""`panoptic calibrate`: a rig from recordings of a board, and the print of a board."""

from __future__ import annotations

import argparse
from pathlib import Path

from panoptic_ros.cli.calibrate_free import (
    add_pattern_options,
    add_people_options,
    finish,
    run_pattern,
    run_people,
)
from panoptic_ros.cli.calibrate_live import add_live_options, check_live_usage, record_live
from panoptic_ros.errors import UsageError
from panoptic_ros.running.arguments import output_file, output_folder, within

WAND = "wand:"  # begin of the specification of a wand
PRINT = "print"  # first argument that prints a target; a folder of this name is ./print
BOARD = "charuco:5x7:36mm"  # board that is printed by default: it fits A4 and US letter paper


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the verb."""
    parser.add_argument(
        "folder",
        nargs="?",
        metavar="FOLDER|BAG",
        help="folder with one video or folder of images per camera, or a bag with their images; "
        "`print board` writes the board as PDF, `print pattern` a random pattern",
    )
    parser.add_argument("what", nargs="?", metavar="board|pattern", help=argparse.SUPPRESS)
    parser.add_argument(
        "--board",
        default=BOARD,
        metavar="BOARD",
        help="board, or a file that describes one. charuco:COLUMNSxROWS:SIZE counts squares, "
        "checkerboard:9x6:25mm inner corners, aprilgrid:6x6:25mm tags. Markers or gaps of another size: "
        "charuco:5x7:40mm/30mm; other markers: charuco:5x7:40mm:DICT_5X5_100. A wand of bright markers: "
        f"wand:0/150/500mm, with --intrinsics. Default {BOARD}",
    )
    parser.add_argument(
        "--lens",
        choices=("brown", "rational", "fisheye"),
        default="brown",
        help="lens model: 5 terms, 8 terms, or a fisheye with 4; default brown",
    )
    parser.add_argument(
        "--intrinsics", type=Path, metavar="RIG", help="calibration with known intrinsics of some cameras"
    )
    parser.add_argument(
        "--floor",
        type=within(float, 0.0, 1e6),
        metavar="SECONDS",
        help="time after the first image at which the board lies on the floor, face up: it becomes z = 0",
    )
    parser.add_argument(
        "--synchronous", action="store_true", help="cameras are synchronous: estimate no clock offsets"
    )
    parser.add_argument(
        "--depth-sensor",
        action="append",
        default=[],
        metavar="INFRARED=COLOUR",
        help="camera with the infrared images of a depth sensor, and the colour camera in its housing. "
        "INFRARED_depth/ has its depth maps, whose scale is estimated; repeatable",
    )
    add_people_options(parser)
    add_pattern_options(parser)
    add_live_options(parser)
    parser.add_argument("--paper", help="paper of `print board`, e.g. a4; default: the smallest that fits")
    parser.add_argument(
        "--out",
        required=True,
        metavar="DIR",
        help="folder for rig.json, clocks.json and report.html; file board.pdf of `print board`",
    )
    parser.add_argument("--quiet", action="store_true", help="print no summary")


def run(args: argparse.Namespace) -> int:
    """Calibrate the cameras of a folder, or print a board."""
    from panoptic_ros.running.calibration.recorded_board import board_of  # imported here to keep --help fast

    check_live_usage(args)
    if args.paper and args.folder != PRINT:
        raise UsageError("--paper is for `panoptic calibrate print`")
    out = output_file(args.out) if args.folder == PRINT else output_folder(args.out)
    if args.people:
        return run_people(args, output_folder(args.out))
    if args.pattern:
        return run_pattern(args, out)
    if args.stature or args.refine:
        raise UsageError("--stature is for --people, --refine for --pattern; a board gives the scale itself")
    if args.board.startswith(WAND) and args.folder != PRINT:
        return _run_wand(args, out)
    board = board_of(args.board)
    if args.folder == PRINT:
        from panoptic_ros.view.board_print import write_board, write_pattern

        if args.what == "pattern":
            paper = write_pattern(out, args.paper or "")
            print(f"{out}: random pattern on {paper} paper; project it, or print it several times")
            return 0
        if args.what != "board":
            raise UsageError(
                f"`panoptic calibrate print` prints a board or a pattern; give `print board --out {args.out}`"
            )
        paper = write_board(out, board, args.board, args.paper or "")
        print(f"{out}: {args.board} on {paper} paper; print it at 100 % and measure it")
        return 0
    if args.what is not None:
        raise UsageError(f"{args.what}: one folder is expected; options begin with --")
    if args.live:
        args.folder = record_live(args, out, board)
    from panoptic_ros.io.rigs.intrinsics import read_intrinsics
    from panoptic_ros.running.calibration.calibrate import calibrate_recording
    from panoptic_ros.running.calibration.depth_sensors import sensors_of
    from panoptic_ros.view.progress import PassBar

    known = read_intrinsics(args.intrinsics) if args.intrinsics else None
    with PassBar("images") as bar:
        found = calibrate_recording(
            Path(args.folder),
            board,
            bar.show,
            lens=args.lens,
            known=known,
            floor_s=args.floor,
            synchronous=args.synchronous,
            distance=args.distance,
            sensors=sensors_of(args.depth_sensor),
        )
    return finish(args, out, found)


def _run_wand(args: argparse.Namespace, out: Path) -> int:
    """Calibrate cameras with known lenses from a wand."""
    from panoptic_ros.io.rigs.intrinsics import read_intrinsics
    from panoptic_ros.running.calibration.calibrate import calibrate_with_wand
    from panoptic_ros.view.progress import PassBar

    if args.floor is not None or args.lens != "brown" or args.depth_sensor:
        raise UsageError(
            "--floor, --lens and --depth-sensor are for boards; a wand refines the lenses of --intrinsics"
        )
    known = read_intrinsics(args.intrinsics) if args.intrinsics else None
    with PassBar("images") as bar:
        found = calibrate_with_wand(
            Path(args.folder), args.board, bar.show, known, args.synchronous, args.distance
        )
    return finish(args, out, found)
