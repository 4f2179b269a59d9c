"""The studies `faults` (damaged files of every format) and `accidents` (accidents of live takes)."""

from __future__ import annotations

import argparse
import json
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from panoptic_ros.running.arguments import within
from panoptic_ros.stage import Progress
from panoptic_ros.study.options import add_seeds, known_names, words
from panoptic_ros.study.study import Case, Column, Result, Row, Study

CHILD = "panoptic_ros.study.faults.damage_child"
GRACE_S = 120.0  # timeout beyond the time of the trials, for imports and for one copy


class Faults(Study):
    """Damaged copies of every format's sample are read, each format in a process of its own."""

    columns = (
        Column("format", "format"),
        Column("mutations", "mutations"),
        Column("refused", "refused"),
        Column("accepted", "accepted"),
        Column("exceptions", "foreign"),
        Column("slowest_s", "slowest s", ".2f"),
        Column("peak_mb", "peak MB", ".0f"),
    )

    @classmethod
    def add_options(cls, parser: argparse.ArgumentParser) -> None:
        """See `Study`."""
        parser.add_argument(
            "--seconds",
            type=within(float, 0.1, 1e5),
            default=60.0,
            metavar="S",
            help="time per format; default 60",
        )
        add_seeds(parser, "1")
        parser.add_argument(
            "--formats", type=words, default=[], metavar="NAME,NAME", help="test only these formats"
        )
        parser.add_argument(
            "--keep",
            type=Path,
            default=Path("faults"),
            metavar="DIR",
            help="folder for copies that raise a foreign exception; default faults",
        )

    def cases(self) -> list[Case]:
        """See `Study`."""
        from panoptic_ros.study.faults.formats import FORMATS  # imported here because numba is slow to load

        names = known_names(self.options.formats, FORMATS, "format") or list(FORMATS)
        return [Case(f"{name} {seed}", (name, seed)) for seed in self.options.seeds for name in names]

    def measure(self, case: Case, progress: Progress) -> list[Row]:
        """See `Study`."""
        row = _trials(case.request[0], case.request[1], self.options.seconds, self.options.keep)
        return [row | {"exceptions": sum(max(1, len(numbers)) for numbers in row["foreign"].values())}]

    def lines(self, result: Result) -> Iterator[str]:
        """See `Study`."""
        yield from super().lines(result)
        for row in result["rows"]:
            for text, numbers in row["foreign"].items():
                of = ", ".join(map(str, numbers[:5])) or "unknown"
                yield f"{row['format']}: {text}; mutations {of}"


class Accidents(Study):
    """Accidents of live takes: terminals that close, disks that fill, processes that are killed."""

    columns = (
        Column("name", "accident"),
        Column("code", "exit code"),
        Column("lost_s", "lost s", ".2f"),
        Column("fault", "fault"),
        Column("said", "last line"),
    )

    @classmethod
    def add_options(cls, parser: argparse.ArgumentParser) -> None:
        """See `Study`."""
        parser.add_argument(
            "--only", default="", metavar="TEXT", help="only accidents whose names contain this text"
        )
        add_seeds(parser, "1")

    def measure(self, case: Case, progress: Progress) -> list[Row]:
        """See `Study`."""
        # the start of the program must not need this module
        from panoptic_ros.study.faults.accidents import stage_accidents

        found = stage_accidents(self.options.seeds.start, self.options.only, progress)
        return [asdict(outcome) for outcome in found]

    def lines(self, result: Result) -> Iterator[str]:
        """See `Study`."""
        yield from super().lines(result)
        failed = sum(bool(row["fault"]) for row in result["rows"])
        yield f"{failed} of {len(result['rows'])} accidents at fault"


def _trials(name: str, seed: int, seconds: float, keep: Path) -> dict[str, Any]:
    """Try one format and save the copies that raise foreign exceptions."""
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
    """Save the files in use when a child process crashed."""
    shutil.copytree(folder, kept, dirs_exist_ok=True)


def _keep_copies(name: str, seed: int, foreign: dict[str, Sequence[int]], keep: Path) -> None:
    """Save the first copy of each finding."""
    from panoptic_ros.study.faults.formats import FORMATS
    from panoptic_ros.study.faults.trials import copy_of

    for number in (numbers[0] for numbers in foreign.values() if numbers):
        with tempfile.TemporaryDirectory() as folder:
            path = FORMATS[name].sample(Path(folder))
            keep.mkdir(parents=True, exist_ok=True)
            data = copy_of(name, path.read_bytes(), seed, number)
            (keep / f"{name.replace('/', '_')}-{seed}-{number}-{path.name}").write_bytes(data)


def _text(output: bytes | str | None) -> str:
    return output.decode() if isinstance(output, bytes) else output or ""
