"""Progress bars: one for a known number of frames, one for work that reports its finished share."""

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
REDRAW_S = 0.1  # s between redraws
# s; window of the speed estimate, so long that it covers a whole pass, because its steps differ in speed
MEAN_S = 1e6
Bar = TypeVar("Bar", bound="PassBar")


class _Rate(ProgressColumn):
    def render(self, task: Task) -> Text:
        return Text(f"{task.finished_speed or task.speed or 0.0:.1f} frames/s")


class PassBar:
    """Progress bar with the finished share, the time left and the current step. `show` is a `stage.Progress`.

    It redraws one line of sys.stderr in place, and prints nothing if sys.stderr is not a terminal. It is a
    context manager; leaving it ends the line.

    Args:
        label: Name of the whole task.
        total: Value that `show` receives at the end, None if unknown.
    """

    def __init__(self, label: str = "", total: float | None = 1.0):
        self._total, self._drawn_s = total, 0.0
        self._progress = Progress(
            "{task.description}",
            *self._columns(),
            console=Console(stderr=True, highlight=False),
            auto_refresh=False,  # auto refresh is a thread, and processes are forked while bars are drawn
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
        """Show the finished share, 0..1, and the current step."""
        self._progress.update(self._task, completed=share, doing=doing)
        if share == self._total or time.monotonic() - self._drawn_s >= REDRAW_S:
            self._drawn_s = time.monotonic()
            self._progress.refresh()

    def close(self) -> None:
        """End the line; a second call does nothing."""
        self._progress.stop()

    def __enter__(self: Bar) -> Bar:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


class ProgressBar(PassBar):
    """Progress bar with the number of finished frames, frames per second and time left.

    Args:
        total: Number of expected frames, None if unknown.
        label: Name of the task.
    """

    def __init__(self, total: int | None, label: str = ""):
        super().__init__(label, total or None)

    def _columns(self) -> tuple[ProgressColumn | str, ...]:
        if self._total is None:
            return "{task.completed} frames", _Rate(), TimeElapsedColumn()
        return BarColumn(WIDTH), MofNCompleteColumn(), _Rate(), TimeRemainingColumn(compact=True), "left"

    def update(self, done: int) -> None:
        """Show `done` finished frames."""
        self.show(done, "")
