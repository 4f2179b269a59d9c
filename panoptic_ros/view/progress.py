"""A progress bar for work of known length."""
from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import TextIO

WIDTH = 28
REDRAW_S = 0.1


class ProgressBar:
    """One line that is redrawn in place: share done, frames per second, time left.

    Quiet if the stream is no terminal. A context manager; leaving it ends the line.

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
        self._total = total
        self._label = label
        self._stream = sys.stderr if stream is None else stream
        self._clock = clock
        self._visible = self._stream.isatty()
        self._start = clock()
        self._drawn_at = -REDRAW_S
        self._done = 0
        self._open = True

    def update(self, done: int) -> None:
        """So many frames are done."""
        self._done = done
        now = self._clock() - self._start
        if self._visible and self._open and (now - self._drawn_at >= REDRAW_S or done == self._total):
            self._drawn_at = now
            self._stream.write(f"\r{self.line(now)}\x1b[K")
            self._stream.flush()

    def line(self, elapsed_s: float) -> str:
        """The text of the line."""
        rate = self._done / elapsed_s if elapsed_s > 0 else 0.0
        if not self._total:
            text = f"{self._label} {self._done} frames  {rate:.1f} frames/s  {_clock_text(elapsed_s)}"
            return text.lstrip()
        share = min(1.0, self._done / self._total)
        full = int(share * WIDTH)
        bar = "#" * full + "." * (WIDTH - full)
        left = _clock_text((self._total - self._done) / rate) if rate > 0 else "--:--"
        text = f"{self._label} [{bar}] {self._done}/{self._total}  {rate:.1f} frames/s  {left} left"
        return text.lstrip()

    def close(self) -> None:
        """End the line; does nothing the second time."""
        if self._visible and self._open:
            self._stream.write(f"\r{self.line(self._clock() - self._start)}\x1b[K\n")
            self._stream.flush()
        self._open = False

    def __enter__(self) -> ProgressBar:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


def _clock_text(seconds: float) -> str:
    minutes, rest = divmod(max(0, round(seconds)), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes:02d}:{rest:02d}"
