"""`panoptic bench faults`: damaged and hostile files of every format, and accidents of live takes."""

from __future__ import annotations

import argparse
import json
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from panoptic_ros.errors import UsageError
from panoptic_ros.stage import Progress, each

ABOUT = "damaged and hostile files of every format, and what accidents cost live takes"
CHILD = "panoptic_ros.running.benches.damage.child"
ALL = "*"
GRACE_S = 120.0  # beyond the time of the trials, for loading and for one copy


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of this bench."""
    parser.add_argument(
        "--seconds", type=float, default=60.0, metavar="S", help="of mutations per format; default 60"
    )
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="of the mutations; default 1")
    parser.add_argument("--formats", default="", metavar="NAME,NAME", help="only these, and no accidents")
    parser.add_argument(
        "--live",
        nargs="?",
        const=ALL,
        default="",
        metavar="NAME",
        help="only accidents of live takes, those whose name has this text",
    )
    parser.add_argument(
        "--keep",
        type=Path,
        default=Path("faults"),
        metavar="DIR",
        help="folder for copies that raise an exception of others; default faults",
    )


def measure(args: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    """Read damaged copies of every format's sample, each format in a process of its own.

    Raises:
        UsageError: on a format or an accident that is not there.
    """
    if args.formats and args.live:
        raise UsageError("--formats and --live exclude each other")
    accidents = [] if args.formats else _accidents(args, progress)
    if args.live:
        return {"seed": args.seed, "seconds": args.seconds, "rows": [], "accidents": accidents}
    from panoptic_ros.running.benches.damage.formats import FORMATS  # numba is slow to load

    names = [name.strip() for name in args.formats.split(",") if name.strip()] or list(FORMATS)
    for name in names:
        if name not in FORMATS:
            raise UsageError(f"there is no format {name}; there are {', '.join(FORMATS)}")
    rows = [
        _trials(name, args.seed, args.seconds, args.keep)
        for name in each(names, len(names), progress, "formats")
    ]
    return {"seed": args.seed, "seconds": args.seconds, "rows": rows, "accidents": accidents}


def _accidents(args: argparse.Namespace, progress: Progress) -> list[dict[str, Any]]:
    from panoptic_ros.running.benches.accidents import stage_accidents  # the verb begins without

    found = stage_accidents(args.seed, "" if args.live == ALL else args.live, progress)
    return [asdict(outcome) for outcome in found]


def _trials(name: str, seed: int, seconds: float, keep: Path) -> dict[str, Any]:
    """Try one format; save copies that raise exceptions of others."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", CHILD, name, str(seed), str(seconds), folder]
        try:
            done = subprocess.run(
                command, capture_output=True, text=True, timeout=seconds + GRACE_S, check=False
            )
            told, code = done.stdout.splitlines(), done.returncode
        except subprocess.TimeoutExpired as error:
            told, code = _text(error.stdout).splitlines(), -int(signal.SIGKILL)
        row: dict[str, Any] = json.loads(told[-1]) if told else {"mutations": 0, "foreign": {}}
        row["format"] = name
        if code:
            cause = signal.Signals(-code).name if code < 0 else f"exit code {code}"
            row["foreign"][f"the process ended with {cause}"] = []
            _keep_whole(Path(folder), keep / name.replace("/", "_"))
    _keep_copies(name, seed, row["foreign"], keep)
    return row


def _keep_whole(folder: Path, kept: Path) -> None:
    """Keep what was in work when a process broke down."""
    shutil.copytree(folder, kept, dirs_exist_ok=True)


def _keep_copies(name: str, seed: int, foreign: dict[str, Sequence[int]], keep: Path) -> None:
    """Keep the first copy of each finding."""
    from panoptic_ros.running.benches.damage.formats import FORMATS
    from panoptic_ros.running.benches.damage.trials import copy_of

    for number in (numbers[0] for numbers in foreign.values() if numbers):
        with tempfile.TemporaryDirectory() as folder:
            path = FORMATS[name].sample(Path(folder))
            keep.mkdir(parents=True, exist_ok=True)
            data = copy_of(name, path.read_bytes(), seed, number)
            (keep / f"{name.replace('/', '_')}-{seed}-{number}-{path.name}").write_bytes(data)


def _text(output: bytes | str | None) -> str:
    return output.decode() if isinstance(output, bytes) else output or ""


def lines(result: dict[str, Any]) -> list[str]:
    """Return the tables, and below each its findings."""
    accidents = [_accident_line(row) for row in result["accidents"]]
    if accidents:
        title = f"accident, seed {result['seed']}"
        head = f"{title:<38}{'exit code':>10}{'lost s':>8}  fault, or the last line"
        failed = sum(bool(row["fault"]) for row in result["accidents"])
        accidents = [head, *accidents, f"{failed} of {len(accidents)} accidents at fault"]
    if not result["rows"]:
        return accidents
    text = [
        *accidents,
        *([""] if accidents else []),
        f"seed {result['seed']}, {result['seconds']:g} s of mutations per format",
        f"{'format':<22}{'mutations':>10}{'refused':>9}{'accepted':>9}{'foreign':>9}"
        f"{'slowest s':>11}{'peak MB':>9}",
    ]
    for row in result["rows"]:
        foreign = sum(max(1, len(numbers)) for numbers in row["foreign"].values())
        text.append(
            f"{row['format']:<22}{row['mutations']:10}{row.get('refused', 0):9}{row.get('accepted', 0):9}"
            f"{foreign:9}{row.get('slowest_s', 0.0):11.2f}{row.get('peak_mb', 0.0):9.0f}"
        )
    for row in result["rows"]:
        for told, numbers in row["foreign"].items():
            text.append(f"{row['format']}: {told}; mutations {', '.join(map(str, numbers[:5])) or 'unknown'}")
    return text


def _accident_line(row: dict[str, Any]) -> str:
    lost = "-" if row["lost_s"] is None else f"{row['lost_s']:.2f}"
    told = f"FAULT: {row['fault']}" if row["fault"] else row["said"][:100]
    return f"{row['name']:<38}{row['code']!s:>10}{lost:>8}  {told}"
