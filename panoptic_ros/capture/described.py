"""Open image sources from plain descriptions, as in a run's plan and in a launcher's file.

Sources are live cameras, recordings played back as live cameras, and the cameras of a recording. A recording
gives frames of each camera, and depth maps if it has any.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from functools import partial
from itertools import count, tee
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from panoptic_ros.capture.at_once import opened_at_once
from panoptic_ros.capture.depth_folder import DepthSource
from panoptic_ros.capture.device import DeviceOptions, DeviceSource
from panoptic_ros.capture.folder import open_capture_folder, open_files
from panoptic_ros.capture.image_size import fit_camera
from panoptic_ros.capture.source import SECOND_NS, FrameSource
from panoptic_ros.domain import Camera, Rig, ViewFrame
from panoptic_ros.errors import UsageError
from panoptic_ros.stage import Notice


def open_source(camera: str, rig: Rig, description: Mapping[str, Any]) -> tuple[FrameSource, Camera]:
    """Open one camera's source; return it with the camera calibration for its image size.

    Args:
        description: {"kind": "folder" | "file" | "device" | "played", "path" or "device", and options of the
            source}. A played folder has "rate_hz" and "start_ns" (see `PlaybackSource`).

    Raises:
        UserError: as `open_capture_folder`, `open_files` and `open_live`.
    """
    kind = description["kind"]
    options = {k: v for k, v in description.items() if k not in ("kind", "path", "device")}
    if kind == "device":
        return open_live(camera, rig, description["device"], options), rig.camera(camera)
    if kind == "played":
        capture = open_capture_folder(Path(description["path"]), rig=rig, cameras=[camera])
        return PlaybackSource(capture.sources[0], options["rate_hz"], options["start_ns"]), rig.camera(camera)
    if kind == "folder":
        capture = open_capture_folder(Path(description["path"]), rig=rig, cameras=[camera], **options)
    elif kind == "file":
        capture = open_files(rig.subset([camera]), {camera: Path(description["path"])}, **options)
    else:
        raise UsageError(f"camera {camera}: there is no source of kind {kind!r}")
    return capture.sources[0], capture.rig.camera(camera)


def open_live(camera: str, rig: Rig, device: str, options: Mapping[str, Any]) -> DeviceSource:
    """Open a device whose images have the size for which the camera is calibrated.

    Args:
        options: fields of `DeviceOptions` as plain values.

    Raises:
        BackendError: if it cannot be opened.
        CalibrationError: if its images have another size.
    """
    calibrated = rig.camera(camera)
    wishes = DeviceOptions(**{"image_size": calibrated.image_size, **options})
    source = DeviceSource(camera, device, options=wishes)
    try:
        fit_camera(calibrated, source.image_size)
    except BaseException:
        source.close()
        raise
    return source


OVERTAKEN = 2  # periods after which an unread frame is dropped, as on a device
MOST_KEPT = 400_000_000  # bytes of frames of one recording that are kept in memory


class PlaybackSource:
    """Recording played back as a live camera, at a given rate, in an endless loop.

    Frame n is due, and timestamped, at start_ns + n / rate. A short recording is decoded once and played
    forward and backward, so that people do not jump. Its frames are kept as YUV 4:2:0, the format of cameras.
    Reading a frame then only needs the conversion to BGR, as with a camera. In a long recording each frame is
    decoded when it is due, a cost that a camera does not have. After its last frame it restarts at the first.

    Cameras with the same start and rate play in sync, whenever they are opened. A frame that is not requested
    in time is dropped, and its number is skipped.

    Args:
        source: A recording of known length.
        rate_hz: Frame rate, instead of the recording's own.
        start_ns: Time of frame 0 on `clock`.
        clock: Returns the time in ns.
        wait: Sleeps for a number of seconds.
        most_kept: Limit in bytes of frames kept in memory.
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
        """Return the number of the frame that is due next."""
        return max(0, math.ceil((self._clock() - self._start_ns) / self._period_ns))

    def _again(self) -> Iterator[tuple[int, Callable[[], np.ndarray]]]:
        """Yield numbers and images of a recording in memory, played forward and backward."""
        kept = [cv2.cvtColor(frame.image, cv2.COLOR_BGR2YUV_I420) for frame in self._source]
        turn = max(2 * len(kept) - 2, 1)
        for number in count(self._next_number()) if kept else ():
            place = number % turn
            picture = kept[min(place, turn - place)]
            yield number, partial(cv2.cvtColor, picture, cv2.COLOR_YUV2BGR_I420)

    def _anew(self) -> Iterator[tuple[int, Callable[[], np.ndarray]]]:
        """Yield numbers and images of a recording that is read again and again."""
        first, number = self._next_number(), -1
        while self._open:
            before = number
            for frame in self._source:
                number += 1
                # begin at the frame that the other cameras have reached
                if number == 0 and self._source.frame_count:
                    number = first - first % self._source.frame_count
                if number >= first:
                    yield number, partial(getattr, frame, "image")
            if number == before:
                return

    def close(self) -> None:
        """End the iteration, and close the recording."""
        self._open = False
        self._source.close()

    def __enter__(self) -> PlaybackSource:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


Note = Callable[[Notice], None]


def open_recording(
    rig: Rig, descriptions: Mapping[str, Mapping[str, Any]], stack: ExitStack, note: Note
) -> dict[tuple[str, str], Iterator[Any]]:
    """Open a recording; return iterators of `ViewFrame`s and `DepthFrame`s.

    Args:
        descriptions: by camera, see `open_source`.
        stack: closes the files.
        note: called with the notices of a camera after its last frame.

    Returns:
        iterators of `ViewFrame`s by ("image", camera), and of `DepthFrame`s by ("depth", camera).

    Raises:
        UserError: as `open_source`.
    """
    records: dict[tuple[str, str], Iterator[Any]] = {}
    sources = opened_at_once(lambda camera: open_source(camera, rig, descriptions[camera])[0], descriptions)
    for camera, source in zip(descriptions, sources):
        stack.enter_context(source)
        frames, again = tee(_noted(source, note))
        records["image", camera] = frames
        if isinstance(source, DepthSource):
            records["depth", camera] = map(source.depth_of, again)
    return records


def _noted(source: FrameSource, note: Note) -> Iterator[ViewFrame]:
    """Yield the frames of a source; after the last one, pass on its notices."""
    yield from source
    for notice in getattr(source, "after", ()):  # live sources have no last frame
        note(notice)
