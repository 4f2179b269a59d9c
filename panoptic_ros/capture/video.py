"""Video files, through OpenCV."""
from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np

from panoptic_ros.capture.container import find_cut, hidden_seconds
from panoptic_ros.capture.opencv import quiet_opencv
from panoptic_ros.capture.source import SECOND_NS, check_stamps, exact_rate
from panoptic_ros.domain import ViewFrame
from panoptic_ros.errors import DataError

GRID_TOLERANCE_S = 1.01e-3  # Matroska keeps whole milliseconds; anything nearer is on the grid


class VideoSource:
    """The frames of a video file. Iterating starts at the first frame every time.

    Images are upright: OpenCV turns them as the file's rotation mark says, so that a phone's
    portrait video is portrait here and `image_size` is the size after turning.

    Stamps: those given; else start_ns + i / frame_rate if a frame rate is given; else the
    container's, counted from its first frame. Container times that lie on the grid of the file's
    own frame rate are set to it exactly (they are rounded in the file), so a constant rate gives
    start_ns + i / rate without drift, also after frames that the recorder left out. From the first
    frame off the grid on, the container's times are used as they are. Where the container
    has none that increase, the frame comes one period after the one before, and is counted in
    `repaired_stamps`.

    Args:
        camera: name.
        path: any file that OpenCV reads.
        start_ns: stamp of the first frame, ns.
        frame_rate: Hz, in place of the file's own times.
        stamps: ns, one per frame, in place of all others.

    Raises:
        DataError: missing, not a video, without frames, cut off. While iterating: fewer frames can
            be decoded than the file says, after all good ones have been handed out.
    """

    def __init__(
        self,
        camera: str,
        path: Path,
        *,
        start_ns: int = 0,
        frame_rate: float | None = None,
        stamps: Sequence[int] | None = None,
    ):
        self.camera = camera
        self.path = Path(path)
        self.repaired_stamps = 0
        self._what = f"video {self.path} of camera {camera}"
        self._start_ns = int(start_ns)
        self._stamps = None if stamps is None else check_stamps(stamps, self._what)
        self._open_now: list[cv2.VideoCapture] = []
        capture = self._open()
        try:
            good, image = _read(capture)
            if not good or image is None:
                raise DataError(f"{self._what} has no frame that can be decoded; record or copy it again")
            self.image_size = (image.shape[1], image.shape[0])
            count = int(capture.get(cv2.CAP_PROP_FRAME_COUNT))
            self.frame_count = count if count > 0 else None
            own_rate = capture.get(cv2.CAP_PROP_FPS)
        finally:
            self._release(capture)
        if frame_rate is None and not 0.01 <= own_rate <= 10_000.0:
            raise DataError(f"{self._what} does not say its frame rate; give one")
        self._own_rate = own_rate
        self._given_rate = frame_rate is not None
        self._rate = exact_rate(own_rate if frame_rate is None else frame_rate, self._what)
        self.frame_rate = float(self._rate)
        if self._stamps is not None and self.frame_count and len(self._stamps) < self.frame_count:
            raise DataError(f"{self._what} has {self.frame_count} frames but {len(self._stamps)} stamps")

    def __iter__(self) -> Iterator[ViewFrame]:
        capture = self._open()
        timeline = _Timeline(self._rate, self._given_rate)
        self.repaired_stamps = 0
        number = 0
        try:
            while capture in self._open_now:  # until close()
                good, image = _read(capture)
                if not good or image is None:
                    self._check_end(number, timeline.seconds)
                    return
                seconds = timeline.step(number, capture.get(cv2.CAP_PROP_POS_MSEC) / 1e3)
                self.repaired_stamps = timeline.repaired
                yield ViewFrame(self.camera, self._stamp(number, seconds), number, image)
                number += 1
        finally:
            self._release(capture)

    def close(self) -> None:
        """Close the file; iterations that are under way end."""
        for capture in list(self._open_now):
            self._release(capture)

    def __enter__(self) -> VideoSource:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def _open(self) -> cv2.VideoCapture:
        if not self.path.is_file():
            state = "is a folder" if self.path.is_dir() else "is not there"
            raise DataError(f"{self._what} {state}; check the path")
        if self.path.stat().st_size == 0:
            raise DataError(f"{self._what} is empty (0 bytes); record or copy it again")
        cut = find_cut(self.path)
        if cut:
            raise DataError(f"{self._what} is cut off: {cut}; copy or record it again")
        with quiet_opencv():
            capture = cv2.VideoCapture(str(self.path))
        if not capture.isOpened():
            raise DataError(f"{self._what} cannot be opened: no video, or damaged, or an unknown codec")
        capture.set(cv2.CAP_PROP_ORIENTATION_AUTO, 1)  # the default today; our promise in any case
        self._open_now.append(capture)
        return capture

    def _release(self, capture: cv2.VideoCapture) -> None:
        capture.release()
        if capture in self._open_now:
            self._open_now.remove(capture)

    def _stamp(self, number: int, seconds: Fraction) -> int:
        if self._stamps is None:
            return self._start_ns + round(seconds * SECOND_NS)
        if number >= len(self._stamps):
            raise DataError(f"{self._what} has more frames than the {len(self._stamps)} stamps given")
        return self._stamps[number]

    def _check_end(self, decoded: int, last: Fraction) -> None:
        """Complain if the file promised more than could be decoded."""
        promised = self.frame_count
        if promised is None or decoded >= promised:
            return
        hidden = hidden_seconds(self.path)
        if hidden == math.inf:
            # the count is no more than duration times rate: compare times, as rates may vary
            lost = promised / self._rate - last - 1 / self._rate
            if lost <= max(Fraction(1), promised / self._rate / 50):
                return
        elif promised - decoded <= hidden * self._own_rate + 0.5:
            return
        raise DataError(
            f"{self._what}: only {decoded} of {promised} frames could be decoded; "
            "the file is damaged or cut off, copy or record it again"
        )


def _read(capture: cv2.VideoCapture) -> tuple[bool, np.ndarray | None]:
    with quiet_opencv():
        return capture.read()


class _Timeline:
    """Seconds since the first frame, from what the container says."""

    def __init__(self, rate: Fraction, ignore_container: bool):
        self.rate = rate
        self.seconds = Fraction(-1)
        self.repaired = 0
        self._ignore = ignore_container
        self._first = 0.0
        self._on_grid = True

    def step(self, number: int, container: float) -> Fraction:
        """Time of frame `number`; `container` is its presentation time in the file, s."""
        if number == 0:
            self._first = container
            self.seconds = Fraction(0)
        elif self._ignore:
            self.seconds = number / self.rate
        else:
            self.seconds = self._next(container - self._first)
        return self.seconds

    def _next(self, since_first: float) -> Fraction:
        if not math.isfinite(since_first):
            since_first = -1.0
        nearest = round(since_first * self.rate) / self.rate
        self._on_grid = self._on_grid and abs(since_first - float(nearest)) <= GRID_TOLERANCE_S
        seconds = nearest if self._on_grid else Fraction(since_first)
        if seconds <= self.seconds:
            self.repaired += 1
            return self.seconds + 1 / self.rate
        return seconds

