"""Progress bars: for work of so many frames, and for work that tells the share that is done."""

from __future__ import annotations

import sys
import time
from typing import TypeVar

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    Task,
    TaskProgressColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.text import Text

WIDTH = 28  # characters of the bar
REDRAW_S = 0.1  # between two drawings
MEAN_S = 1e6  # time left follows from the mean pace of so much work, as steps of a pass take different times
Bar = TypeVar("Bar", bound="PassBar")


class _Rate(ProgressColumn):
    def render(self, task: Task) -> Text:
        return Text(f"{task.finished_speed or task.speed or 0.0:.1f} frames/s")


class PassBar:
    """Share done, time left, and what is being done; `show` is a `stage.Progress`.

    One line of sys.stderr that is redrawn in place; quiet if that is no terminal. A context manager; leaving
    it ends the line.

    Args:
        label: what the whole is.
        total: what `show` is given at the end, None if not known.
    """

    def __init__(self, label: str = "", total: float | None = 1.0):
        self._total, self._drawn_s = total, 0.0
        self._progress = Progress(
            "{task.description}",
            *self._columns(),
            console=Console(stderr=True, highlight=False),
            auto_refresh=False,  # which is a thread, and processes are forked while bars are drawn
            speed_estimate_period=MEAN_S,
            redirect_stdout=False,
            redirect_stderr=False,
            get_time=time.monotonic,
            disable=not sys.stderr.isatty(),
        )
        self._task = self._progress.add_task(label, total=total, doing="")
        self._progress.start()

    def _columns(self) -> tuple[ProgressColumn | str, ...]:
        left = TimeRemainingColumn(compact=True)
        return BarColumn(WIDTH), TaskProgressColumn(), left, "left  {task.fields[doing]}"

    def show(self, share: float, doing: str) -> None:
        """The share that is done, 0..1, and what is being done."""
        self._progress.update(self._task, completed=share, doing=doing)
        if share == self._total or time.monotonic() - self._drawn_s >= REDRAW_S:
            self._drawn_s = time.monotonic()
            self._progress.refresh()

    def close(self) -> None:
        """End the line; does nothing the second time."""
        self._progress.stop()

    def __enter__(self: Bar) -> Bar:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


class ProgressBar(PassBar):
    """Share done, frames per second, time left.

    Args:
        total: frames to come, None if not known.
        label: what is being done.
    """

    def __init__(self, total: int | None, label: str = ""):
        super().__init__(label, total or None)

    def _columns(self) -> tuple[ProgressColumn | str, ...]:
        if self._total is None:
            return "{task.completed} frames", _Rate(), TimeElapsedColumn()
        return BarColumn(WIDTH), MofNCompleteColumn(), _Rate(), TimeRemainingColumn(compact=True), "left"

    def update(self, done: int) -> None:
        """So many frames are done."""
        self.show(done, "")
