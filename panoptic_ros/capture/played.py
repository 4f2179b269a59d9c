"""A recording that is played as if it were a live camera: at its rate, over and over.

A short one is decoded once and played forth and back, so that nobody jumps. Its frames are kept as cameras
give them (YUV 4:2:0): to turn them into BGR is what is left of reading a camera. Of a long one every frame is
decoded when it is due, which costs what no camera costs, and after the last frame comes the first one.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from functools import partial
from itertools import count

import cv2
import numpy as np

from panoptic_ros.capture.source import SECOND_NS, FrameSource
from panoptic_ros.domain import ViewFrame

OVERTAKEN = 2  # periods after which a frame that was not read is lost, as a device would lose it
MOST_KEPT = 400_000_000  # bytes of frames that are kept of one recording


class PlayedSource:
    """Frame n is due, and stamped, at start_ns + n / rate.

    Cameras with one start and rate are played together, whenever they begin. A frame that is not asked for
    in time is left out, and its number is.

    Args:
        source: a recording of known length.
        rate_hz: of the frames, in place of the recording's own.
        start_ns: of `clock`.
        clock: ns. wait: for so many s.
        most_kept: bytes of frames.
    """

    frame_count: int | None = None

    def __init__(
        self,
        source: FrameSource,
        rate_hz: float,
        start_ns: int,
        clock: Callable[[], int] = time.time_ns,
        wait: Callable[[float], None] = time.sleep,
        most_kept: int = MOST_KEPT,
    ):
        self._source, self._clock, self._wait = source, clock, wait
        self.camera, self.image_size, self.frame_rate = source.camera, source.image_size, rate_hz
        self._start_ns, self._period_ns = start_ns, SECOND_NS / rate_hz
        self._most_kept = most_kept
        self._open = True

    def __iter__(self) -> Iterator[ViewFrame]:
        frames = self._again() if self._is_short() else self._anew()
        for number, image in frames:
            due_ns = self._start_ns + round(number * self._period_ns)
            late_ns = self._clock() - due_ns
            if late_ns > OVERTAKEN * self._period_ns:
                continue
            picture = image()
            late_ns = self._clock() - due_ns
            if late_ns < 0:
                self._wait(-late_ns / SECOND_NS)
            if not self._open:
                return
            yield ViewFrame(self.camera, due_ns, number, picture)

    def _is_short(self) -> bool:
        width, height = self.image_size
        size = width * height * 3 // 2 * (self._source.frame_count or 0)
        return 0 < size <= self._most_kept and not (width % 2 or height % 2)

    def _next_number(self) -> int:
        """Of the frame that is due next."""
        return max(0, math.ceil((self._clock() - self._start_ns) / self._period_ns))

    def _again(self) -> Iterator[tuple[int, Callable[[], np.ndarray]]]:
        """Numbers and images of a recording that is kept, forth and back."""
        kept = [cv2.cvtColor(frame.image, cv2.COLOR_BGR2YUV_I420) for frame in self._source]
        turn = max(2 * len(kept) - 2, 1)
        for number in count(self._next_number()) if kept else ():
            place = number % turn
            picture = kept[min(place, turn - place)]
            yield number, partial(cv2.cvtColor, picture, cv2.COLOR_YUV2BGR_I420)

    def _anew(self) -> Iterator[tuple[int, Callable[[], np.ndarray]]]:
        """Numbers and images of a recording that is read over and over."""
        first, number = self._next_number(), -1
        while self._open:
            before = number
            for frame in self._source:
                number += 1
                if number == 0 and self._source.frame_count:  # begin where the others are by now
                    number = first - first % self._source.frame_count
                if number >= first:
                    yield number, partial(getattr, frame, "image")
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
