"""A recording that is played as if a device heard it now: to try a live run without hardware."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from panoptic_ros.capture.sound.wav import WavSource
from panoptic_ros.domain import AudioBlock


class PlayedSource:
    """A WAV file in real time, stamped by this machine's clock. It ends with the file.

    Args:
        clocks: of the channels, see `AudioBlock`.
        clock: ns; of the stamps, the wall clock unless given.
        wait: for so many seconds; True if the source was closed meanwhile. For tests.

    Raises:
        DataError: see `WavSource`.
    """

    def __init__(
        self,
        device: str,
        path: Path,
        *,
        clocks: Sequence[str] = (),
        clock: Callable[[], int] = time.time_ns,
        wait: Callable[[float], bool] | None = None,
    ):
        self.device, self.clocks = device, tuple(clocks)
        self._file = WavSource(device, path, clocks=clocks)
        self._closed = threading.Event()
        self._clock, self._wait = clock, wait or self._closed.wait

    def __iter__(self) -> Iterator[AudioBlock]:
        began = self._clock()
        for block in self._file:
            left = began + block.end_ns - self._clock()
            if left > 0 and self._wait(left * 1e-9):
                return
            yield replace(block, stamp_ns=began + block.stamp_ns)

    def close(self) -> None:
        """End iterations that are under way."""
        self._closed.set()

    def __enter__(self) -> PlayedSource:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()
