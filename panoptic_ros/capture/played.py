"""A recording that is played as if it were a live camera: at its rate, over and over."""
from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import replace

from panoptic_ros.capture.source import SECOND_NS, FrameSource
from panoptic_ros.domain import ViewFrame

OVERTAKEN = 2  # periods after which a frame that was not read is lost, as a device would lose it


class PlayedSource:
    """Frame n is due, and stamped, at start_ns + n / rate; after the last frame comes the first one again.

    Cameras with one start and rate are played together, whenever they begin. A frame that is not asked for
    in time is left out, and its number is.

    Args:
        source: a recording of known length.
        rate_hz: of the frames, in place of the recording's own.
        start_ns: of `clock`.
        clock: ns. wait: for so many s.
    """

    frame_count: int | None = None

    def __init__(
        self, source: FrameSource, rate_hz: float, start_ns: int,
        clock: Callable[[], int] = time.time_ns, wait: Callable[[float], None] = time.sleep,
    ):  # fmt: skip
        self._source, self._clock, self._wait = source, clock, wait
        self.camera, self.image_size, self.frame_rate = source.camera, source.image_size, rate_hz
        self._start_ns = start_ns
        self._open = True

    def __iter__(self) -> Iterator[ViewFrame]:
        period_ns = SECOND_NS / self.frame_rate
        first = max(0, math.ceil((self._clock() - self._start_ns) / period_ns))
        number = -1
        while self._open:
            before = number
            for frame in self._source:
                number += 1
                if number == 0 and self._source.frame_count:  # begin where the others are by now
                    number = first - first % self._source.frame_count
                if number < first:
                    continue
                if not self._open:
                    return
                due_ns = self._start_ns + round(number * period_ns)
                late_ns = self._clock() - due_ns
                if late_ns < 0:
                    self._wait(-late_ns / SECOND_NS)
                elif late_ns > OVERTAKEN * period_ns:
                    continue
                yield replace(frame, stamp_ns=due_ns, frame_number=number)
            if number == before:
                return

    def close(self) -> None:
        """End the iteration, and close the recording."""
        self._open = False
        self._source.close()

    def __enter__(self) -> PlayedSource:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()
