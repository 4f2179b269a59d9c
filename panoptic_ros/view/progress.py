"""Progress bars: for work of so many frames, and for work that tells the share that is done."""

from __future__ import annotations

import math
import shutil
import sys
import time
from collections.abc import Callable
from typing import TextIO

WIDTH = 28
REDRAW_S = 0.1
FIRST_ESTIMATE_S = 1.0  # of work, before which nothing is said of the time left
SETTLING_S = 4.0  # in which the expected end moves most of the way to a new estimate


class _Line:
    """One line that is redrawn in place. Quiet if the stream is no terminal.

    A context manager; leaving it ends the line.
    """

    def __init__(self, stream: TextIO | None, clock: Callable[[], float]):
        self._stream = sys.stderr if stream is None else stream
        self._clock = clock
        self._visible = self._stream.isatty()
        self._start = clock()
        self._drawn_at = -REDRAW_S
        self._open = True

    def line(self, elapsed_s: float) -> str:
        """The text of the line."""
        raise NotImplementedError

    def _draw(self, elapsed_s: float, at_once: bool) -> None:
        """Write the line if the last one was written long enough ago."""
        if self._visible and self._open and (at_once or elapsed_s - self._drawn_at >= REDRAW_S):
            self._drawn_at = elapsed_s
            self._stream.write(f"\r{self.line(elapsed_s)}\x1b[K")
            self._stream.flush()

    def close(self) -> None:
        """End the line; does nothing the second time."""
        if self._visible and self._open:
            self._stream.write(f"\r{self.line(self._clock() - self._start)}\x1b[K\n")
            self._stream.flush()
        self._open = False

    def __exit__(self, *exception: object) -> None:
        self.close()


class ProgressBar(_Line):
    """Share done, frames per second, time left.

    Args:
        total: frames to come, None if not known.
        label: what is being done.
        stream: sys.stderr unless given.
        clock: seconds that never go back; for tests.
    """

    def __init__(
        self,
        total: int | None,
        label: str = "",
        stream: TextIO | None = None,
        clock: Callable[[], float] = time.monotonic,
    ):
        super().__init__(stream, clock)
        self._total = total
        self._label = label
        self._done = 0

    def update(self, done: int) -> None:
        """So many frames are done."""
        self._done = done
        self._draw(self._clock() - self._start, done == self._total)

    def line(self, elapsed_s: float) -> str:
        """The text of the line."""
        rate = self._done / elapsed_s if elapsed_s > 0 else 0.0
        if not self._total:
            text = f"{self._label} {self._done} frames  {rate:.1f} frames/s  {_clock_text(elapsed_s)}"
            return text.lstrip()
        bar = _bar(min(1.0, self._done / self._total))
        left = _clock_text((self._total - self._done) / rate) if rate > 0 else "--:--"
        text = f"{self._label} {bar} {self._done}/{self._total}  {rate:.1f} frames/s  {left} left"
        return text.lstrip()

    def __enter__(self) -> ProgressBar:
        return self


class TimeLeft:
    """Time left of work that tells the share that is done.

    The end is expected at the mean pace so far. It moves slowly towards new estimates, so that what is
    shown counts down and does not jump where steps take longer than others.
    """

    def __init__(self) -> None:
        self._end: float | None = None  # s since the start
        self._at = 0.0  # s, of the last estimate

    def update(self, share: float, elapsed_s: float) -> None:
        """The share that is done, 0..1, and the time since the start."""
        if share <= 0.0 or elapsed_s < FIRST_ESTIMATE_S:
            return
        end = elapsed_s / share
        weight = 1.0 if self._end is None else 1.0 - math.exp((self._at - elapsed_s) / SETTLING_S)
        self._end = end if self._end is None else self._end + weight * (end - self._end)
        self._at = elapsed_s

    def seconds(self, elapsed_s: float) -> float | None:
        """Time left (s); None while nothing is known of it."""
        return None if self._end is None else max(0.0, self._end - elapsed_s)


class PassBar(_Line):
    """Share done, time left, and what is being done; `show` is a `stage.Progress`.

    Args:
        label: what the whole is.
        stream: sys.stderr unless given.
        clock: seconds that never go back; for tests.
    """

    def __init__(
        self, label: str = "", stream: TextIO | None = None, clock: Callable[[], float] = time.monotonic
    ):
        super().__init__(stream, clock)
        self._label = label
        self._share, self._doing = 0.0, ""
        self._left = TimeLeft()

    def show(self, share: float, doing: str) -> None:
        """The share that is done, 0..1, and what is being done."""
        elapsed_s = self._clock() - self._start
        self._share, self._doing = share, doing
        self._left.update(share, elapsed_s)
        self._draw(elapsed_s, share >= 1.0)

    def line(self, elapsed_s: float) -> str:
        """The text of the line, no longer than the terminal is wide."""
        seconds = self._left.seconds(elapsed_s)
        left = "--:--" if seconds is None else _clock_text(seconds)
        text = f"{self._label} {_bar(self._share)} {100 * self._share:3.0f} %  {left} left  {self._doing}"
        return text.strip()[: shutil.get_terminal_size().columns - 1]

    def __enter__(self) -> PassBar:
        return self


def _bar(share: float) -> str:
    full = int(share * WIDTH)
    return f"[{'#' * full}{'.' * (WIDTH - full)}]"


def _clock_text(seconds: float) -> str:
    minutes, rest = divmod(max(0, round(seconds)), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes:02d}:{rest:02d}"
