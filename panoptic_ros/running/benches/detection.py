"""`panoptic bench detection`: what detection costs and gives under every setting, on one capture."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from panoptic_ros.bench.detection import FULL, Footage, measured, variants
from panoptic_ros.errors import UsageError
from panoptic_ros.graph.build import config_class, parse_setting
from panoptic_ros.io.compared_skeletons import only_joints, read_sequence
from panoptic_ros.params import load
from panoptic_ros.stage import Progress, each, untold

ABOUT = "detection: processor time and accuracy of looks, regions and carrying, beside every image"
COLUMNS = (
    ("ms", "cpu_ms", 1),
    ("1 /", "gain", 2),
    ("beside net", "beside_ms", 2),
    ("carrying", "carry_ms", 2),
    ("after", "after_ms", 1),
    ("median mm", "median_mm", 1),
    ("PCK 5 cm", "pck_5", 3),
    ("10 cm", "pck_10", 3),
    ("found", "found_persons", 0),
    ("of", "truth_persons", 0),
    ("reported", "result_persons", 0),
    ("switches", "id_switches", 0),
    ("come", "newcomers", 0),
    ("missed", "newcomers_missed", 0),
    ("after s", "newcomers_wait_s", 2),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the bench."""
    parser.add_argument("capture", metavar="CAPTURE_DIR", help="a capture folder")
    parser.add_argument("--truth", metavar="FILE", help="its true skeletons; default: truth.json.gz in it")
    parser.add_argument("--cameras", metavar="A,B", help="only these")
    parser.add_argument("--frames", type=int, metavar="N", help="the first of each camera")
    parser.add_argument("--every", type=int, default=1, metavar="N", help="only each N-th frame")
    parser.add_argument("--apart", action="store_true", help="every other camera half a period later")
    parser.add_argument("--rate", type=float, default=25.0, metavar="HZ", help="of the frames; default 25")
    parser.add_argument("--joints", default="coco17", metavar="NAMES", help="that count; default coco17")
    parser.add_argument("--skip", type=int, default=6, metavar="N", help="first frames not scored; default 6")
    parser.add_argument(
        "--only",
        action="append",
        metavar="TEXT",
        help=f'settings whose names contain it, beside "{FULL}" (repeat for more)',
    )
    parser.add_argument(
        "--detection",
        action="append",
        metavar="A=1,B=2",
        help="one more setting: parameters of detection",
    )
    parser.add_argument("--set", action="append", default=[], metavar="STAGE.NAME=VALUE", help="for all")
    parser.add_argument("--plot", metavar="FILE.png", help="error over processor time")


def measure(args: argparse.Namespace, progress: Progress = untold) -> dict[str, Any]:
    """Every setting on the same images.

    Raises:
        UsageError: on numbers or names that make no sense.
        UserError: if the capture or the truth cannot be read.
    """
    if args.every < 1 or args.rate <= 0.0 or (args.frames is not None and args.frames < 1):
        raise UsageError("--every, --rate and --frames must be positive")
    folder = Path(args.capture)
    cameras = tuple(args.cameras.split(",")) if args.cameras else None
    if args.apart and args.every < 2:
        raise UsageError("--apart needs --every 2 or more: cameras have frames that others leave out")
    footage = Footage(folder, cameras, args.frames, args.every, args.apart)
    truth = only_joints(read_sequence(Path(args.truth or folder / "truth.json.gz")), args.joints)
    settings: dict[str, dict[str, Any]] = {}
    for text in args.set:
        stage, name, value = parse_setting(text)
        settings.setdefault(stage, {})[name] = value
    chosen = _chosen(args)
    rows = [
        {"setting": name, "parameters": own, **measured(footage, truth, own, settings, args.skip)}
        for name, own in each(list(chosen.items()), len(chosen), progress, "running")
    ]
    for row in rows:
        row["gain"] = rows[0]["cpu_ms"] / row["cpu_ms"]
        row["pck_5"], row["pck_10"] = (row["pck_of_everybody"].get(key) for key in ("0.05", "0.10"))
    result = {"bench": "detection", "capture": str(folder), "cameras": cameras, "rows": rows}
    if args.plot:
        from panoptic_ros.view.detection_plot import write_plot  # matplotlib is slow to load

        write_plot(Path(args.plot), rows, f"{folder}, {rows[0]['instants']} instants")
    return result


def lines(result: dict[str, Any]) -> list[str]:
    """The table: processor time per instant of all cameras together."""
    rows = result["rows"]
    width = max(len(row["setting"]) for row in rows) + 2
    out = [
        f"{result['capture']}: {rows[0]['instants']} instants; ms of processor time of detection per "
        "instant; of a look beside the network; of a view that is carried",
        "",
        f"{'':<{width}}" + "".join(f"{title:>11}" for title, _, _ in COLUMNS),
    ]
    for row in rows:
        cells = (_cell(row[key], digits) for _, key, digits in COLUMNS)
        out.append(f"{row['setting']:<{width}}" + "".join(cells))
    return out


def _cell(value: float | None, digits: int) -> str:
    return f"{'-':>11}" if value is None else f"{value:>11.{digits}f}"


def _chosen(args: argparse.Namespace) -> dict[str, dict[str, Any]]:
    """Parameters of detection by the name of the setting; every image comes first."""
    everything = variants(args.rate / args.every)
    wanted = {
        name: own
        for name, own in everything.items()
        if name == FULL or args.only is None or any(text in name for text in args.only)
    }
    if args.only is not None and len(wanted) == 1 and not args.detection and args.only != [FULL]:
        raise UsageError(f"no setting contains {args.only[0]!r}; there are {', '.join(everything)}")
    for text in args.detection or ():
        parts = [parse_setting(f"detection.{part}") for part in text.split(",")]
        wanted[text] = {name: value for _, name, value in parts}
    for own in wanted.values():
        load(config_class("detection"), own, where="detection.")
        if own.get("threads", 1) != 1:
            raise UsageError(
                f"detection.threads = {own['threads']}: the processor time of one thread is told; leave it 1"
            )
    return wanted
