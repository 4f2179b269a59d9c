"""`panoptic calibrate`: a rig from recordings of a board."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from panoptic_ros.running.arguments import output_folder, within


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the verb."""
    parser.add_argument(
        "folder", type=Path, metavar="FOLDER", help="one video or folder of images per camera"
    )
    parser.add_argument(
        "--board",
        required=True,
        metavar="BOARD",
        help="charuco:COLUMNSxROWS:SIZE in squares, checkerboard:8x6:25mm in inner corners, aprilgrid:6x6:88mm "
        "in tags; markers or gaps of another size: charuco:5x7:40mm/30mm; other markers: "
        "charuco:5x7:40mm:DICT_5X5_100",
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
        "--out",
        type=output_folder,
        required=True,
        metavar="DIR",
        help="folder for rig.json, clocks.json and report.html",
    )
    parser.add_argument("--quiet", action="store_true", help="print no summary")


def run(args: argparse.Namespace) -> int:
    """Calibrate the cameras of a folder and write the result."""
    from panoptic_ros.calibration.boards import parse_board  # imported here to keep --help fast
    from panoptic_ros.running.calibration.calibrate import calibrate_folder
    from panoptic_ros.running.calibration.results import write_calibration
    from panoptic_ros.running.plans.rig_files import read_rig_at
    from panoptic_ros.view.calibration_report import quality_table
    from panoptic_ros.view.progress import PassBar

    board = parse_board(args.board)
    known = read_rig_at(args.intrinsics) if args.intrinsics else None
    with PassBar("images") as bar:
        found = calibrate_folder(
            args.folder,
            board,
            bar.show,
            lens=args.lens,
            known=known,
            floor_s=args.floor,
            synchronous=args.synchronous,
        )
    write_calibration(args.out, found)
    for line in (*found.notices, *found.doubts):
        print(f"warning: {line}", file=sys.stderr)
    if not args.quiet:
        print("\n".join(quality_table(found.quality)))
        print(f"{args.out}: rig.json, clocks.json, report.html")
    return 0
