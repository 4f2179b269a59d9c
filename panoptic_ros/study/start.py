"""The study `start`: seconds from the start of a command to its end, with a warm file cache."""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from panoptic_ros.errors import EnvironmentProblem
from panoptic_ros.running.arguments import within
from panoptic_ros.stage import Progress, each
from panoptic_ros.study.study import Case, Column, Result, Row, Study

PROGRAM = "import sys; from panoptic_ros.cli.main import program; sys.exit(program())"
SCENE, FRAMES = "clean-4p5v", 3
# limit for `panoptic solve` on a small file, idle machine; includes the import of every module
BUDGET_S = 1.0


class Start(Study):
    """Each command runs several times in a process of its own; the first run is not timed."""

    columns = (
        Column("command", "command"),
        Column("median_s", "median s", ".2f"),
        Column("least_s", "least", ".2f"),
    )

    @classmethod
    def add_options(cls, parser: argparse.ArgumentParser) -> None:
        """See `Study`."""
        parser.add_argument(
            "--runs",
            type=within(int, 1, 1000),
            default=10,
            metavar="N",
            help="number of runs of each command; default 10",
        )

    def measure(self, case: Case, progress: Progress) -> Iterator[Row]:
        """See `Study`."""
        with tempfile.TemporaryDirectory(prefix="panoptic-start-") as name:
            folder = Path(name)
            _run(["simulate", SCENE, "--frames", str(FRAMES), "--out", str(folder)])
            files = ["--rig", str(folder / "rig.json"), "--detections", str(folder / "detections.json.gz")]
            commands = {
                "--version": ["--version"],
                "--help": ["--help"],
                "solve, a small file": ["solve", *files, "--out", str(folder / "skeletons.json.gz")],
            }
            for title, words in each(commands.items(), len(commands), progress, "commands"):
                _run(words)
                times = sorted(_run(words) for _ in range(self.options.runs))
                yield {"command": title, "median_s": times[len(times) // 2], "least_s": times[0]}

    def head(self, result: Result) -> str:
        """See `Study`."""
        return f"from a warm cache; the budget of `panoptic solve` on a small file is {BUDGET_S:g} s, idle"


def _run(words: list[str]) -> float:
    """Run a command and return its wall time (s)."""
    begun = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, *words], capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise EnvironmentProblem(f"panoptic {' '.join(words)} failed: {done.stderr.strip()[-200:]}")
    return time.perf_counter() - begun
