"""`panoptic rig`: check whether the views of a calibration agree, convert between formats."""
from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from panoptic_ros.domain import DetectionSet, Rig
from panoptic_ros.errors import UsageError
from panoptic_ros.evaluation.rig_check import RigReport, check_rig
from panoptic_ros.io.plain_formats import read_detections
from panoptic_ros.io.rigs import WRITABLE, find_rig, read_rig, write_rig
from panoptic_ros.io.rigs.camera_info import POSES
from panoptic_ros.io.skeletons import load_skeleton, map_joints

LARGEST_SAMPLE = 200  # detection sets that are looked at


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the verb."""
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    check = actions.add_parser("check", help="say in plain words whether the views agree")
    check.add_argument("rig", type=Path, help="calibration file, or a folder with one")
    check.add_argument("--detections", type=Path, help="detections.json(.gz): 2D people of the same cameras")
    check.add_argument("--json", action="store_true", help="print the findings as JSON")
    convert = actions.add_parser("convert", help="write a calibration in another format, in metres and z up")
    convert.add_argument("source", type=Path, metavar="IN", help="calibration file, or a folder with one")
    convert.add_argument("target", type=Path, metavar="OUT", help="file or, for camera_info, folder to write")
    convert.add_argument("--format", choices=WRITABLE, help="default: from the name of OUT")
    convert.add_argument("--cameras", help="only these, names separated by commas")
    for sub in (check, convert):
        sub.add_argument("--unit", choices=("m", "cm", "mm"), help="of a TOML file that does not state it")
        sub.add_argument("--types", default="", help="CMU Panoptic: vga, hd, kinect-color, ...")
        sub.add_argument("--panels", default="", help="CMU Panoptic: numbers separated by commas")


def run(args: argparse.Namespace) -> int:
    """Check or convert."""
    return _check(args) if args.action == "check" else _convert(args)


def _read(args: argparse.Namespace, path: Path) -> Rig:
    try:
        panels = [int(word) for word in _words(args.panels)]
    except ValueError:
        raise UsageError(f"--panels {args.panels!r} is no list of whole numbers") from None
    if path.is_dir() and not (path / POSES).is_file():  # a capture folder, or what a run left
        path = find_rig(path)
    return read_rig(path, unit=args.unit, types=_words(args.types), panels=panels)


def _words(text: str) -> list[str]:
    return [word.strip() for word in text.split(",") if word.strip()]


def _convert(args: argparse.Namespace) -> int:
    rig = _read(args, args.source)
    if args.cameras:
        rig = rig.subset(_words(args.cameras))
    write_rig(args.target, rig, args.format)
    print(f"{args.target}: {len(rig)} cameras")
    return 0


def _check(args: argparse.Namespace) -> int:
    """Exit code 2 if there is a warning: the user can mend it."""
    rig = _read(args, args.rig)
    skeleton = load_skeleton("panoptic19")
    sets: tuple[DetectionSet, ...] = ()
    if args.detections is not None:
        detections = read_detections(args.detections)
        skeleton, mapping = map_joints("panoptic19", detections.joint_names)
        sets = _sample(tuple(detections.sets(rig, mapping, skeleton.hash)))
    report = check_rig(rig, sets, skeleton)
    print(json.dumps(_document(report), indent=1) if args.json else _table(rig, report))
    return 2 if report.warnings else 0


def _sample(sets: Sequence[DetectionSet]) -> tuple[DetectionSet, ...]:
    """Evenly spread over the file."""
    return tuple(sets[:: max(1, -(-len(sets) // LARGEST_SAMPLE))])


def _document(report: RigReport) -> dict[str, object]:
    cameras = [
        {"camera": fit.camera, "people": fit.people,
         "residual_px": None if np.isnan(fit.residual_px) else fit.residual_px}
        for fit in report.cameras
    ]  # fmt: skip
    notices = [vars(note) | {"values": dict(note.values)} for note in report.notices]
    return {"cameras": cameras, "notices": notices}


def _table(rig: Rig, report: RigReport) -> str:
    width = max(6, *(len(name) for name in rig.names))
    row = f"{{:{width}}}  {{:>11}}  {{:>8}}  {{:>23}}  {{:>12}}  {{:>7}}"
    lines = [row.format("camera", "image", "focal px", "position m", "rays miss px", "matched")]
    for camera, fit in zip(rig.cameras, report.cameras):
        size = f"{camera.image_size[0]} x {camera.image_size[1]}"
        focal = f"{camera.intrinsics.matrix[0, 0]:.1f}"
        place = " ".join(f"{value:7.2f}" for value in camera.centre)
        miss = "-" if np.isnan(fit.residual_px) else f"{fit.residual_px:.1f}"
        lines.append(row.format(camera.name, size, focal, place, miss, fit.people))
    lines += [f"{note.severity}: {note.text}" for note in report.notices]
    if not report.notices:
        lines.append("the views agree")
    return "\n".join(lines)
