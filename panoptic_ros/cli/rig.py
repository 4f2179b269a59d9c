"""`panoptic rig`: check the consistency of a calibration's views, or convert between formats."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from panoptic_ros.domain import Rig
from panoptic_ros.errors import UsageError
from panoptic_ros.io.rigs import WRITABLE, write_rig
from panoptic_ros.running.arguments import camera_distance


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the verb."""
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    check = actions.add_parser("check", help="report in plain words whether the views agree")
    check.add_argument("rig", type=Path, help="calibration file, or a folder with one")
    check.add_argument(
        "--detections",
        type=Path,
        help="2D people of the same cameras: detections.json(.gz), a bag, or the results of a run",
    )
    check.add_argument("--json", action="store_true", help="print the findings as JSON")
    convert = actions.add_parser("convert", help="write a calibration in another format, in metres and z up")
    convert.add_argument("source", type=Path, metavar="IN", help="calibration file, or a folder with one")
    convert.add_argument("target", type=Path, metavar="OUT", help="file or, for camera_info, folder to write")
    convert.add_argument("--format", choices=WRITABLE, help="format of OUT; default: from its name")
    convert.add_argument("--cameras", help="convert only these cameras, names separated by commas")
    convert.add_argument(
        "--up",
        metavar="DIRECTION",
        help="up direction of the world of IN: --up=-y or --up=0.1,-0.9,0.2. The world is rotated so that "
        "+z is up; `rig check` finds the direction from people",
    )
    convert.add_argument(
        "--floor-points",
        type=Path,
        metavar="CSV",
        help="points on the floor, marked in images: columns point, camera, x, y; at least three points, "
        "each in two images. The first becomes the origin, the second is on the x axis, z is up",
    )
    convert.add_argument(
        "--distance",
        type=camera_distance,
        metavar="CAM_A,CAM_B=M",
        help="measured distance of two lenses, m: all lengths are scaled to it",
    )
    for sub in (check, convert):
        sub.add_argument(
            "--unit", choices=("m", "cm", "mm"), help="length unit of a TOML file that does not state it"
        )
        sub.add_argument(
            "--types", default="", help="camera types of a CMU Panoptic rig.json: vga, hd, kinect-color, ..."
        )
        sub.add_argument(
            "--panels", default="", help="panels of a CMU Panoptic rig.json: numbers separated by commas"
        )


def run(args: argparse.Namespace) -> int:
    """Check or convert a calibration."""
    return _check(args) if args.action == "check" else _convert(args)


def _read(args: argparse.Namespace, path: Path, cameras: list[str] | None = None) -> Rig:
    try:
        panels = [int(word) for word in _words(args.panels)]
    except ValueError:
        raise UsageError(f"--panels {args.panels!r} is not a list of whole numbers") from None
    from panoptic_ros.running.plans.rig_files import read_rig_at  # imported here to keep --help fast

    rig = read_rig_at(path, unit=args.unit, types=_words(args.types), panels=panels, cameras=cameras)
    for line in rig.notices:
        print(f"warning: {line}", file=sys.stderr)
    return rig


def _words(text: str) -> list[str]:
    return [word.strip() for word in text.split(",") if word.strip()]


def _convert(args: argparse.Namespace) -> int:
    rig = _read(args, args.source, _words(args.cameras) if args.cameras else None)
    if args.up and args.floor_points:
        raise UsageError("--up and --floor-points both give the up direction; give one of them")
    if args.up:
        from panoptic_ros.running.plans.rig_files import turned

        rig = turned(rig, args.up)
    if args.distance:
        from panoptic_ros.running.plans.rig_files import with_distance

        rig, factor = with_distance(rig, *args.distance)
        print(f"all lengths are multiplied by {factor:.4f}")
    if args.floor_points:
        from panoptic_ros.running.plans.rig_files import on_floor

        rig = on_floor(rig, args.floor_points)
    lost = write_rig(args.target, rig, args.format)
    print(f"{args.target}: {len(rig)} cameras" + (f"; left out: {', '.join(lost)}" if lost else ""))
    return 0


def _check(args: argparse.Namespace) -> int:
    """Check a calibration.

    Returns:
        the exit code: 2 if there is a warning, which the user can correct, else 0.
    """
    from panoptic_ros.running.plans.rig_files import check_views
    from panoptic_ros.view.rig_table import rig_document, rig_table

    rig = _read(args, args.rig)
    report = check_views(rig, args.detections)
    print(json.dumps(rig_document(report), indent=1) if args.json else rig_table(rig, report))
    return 2 if report.warnings else 0
