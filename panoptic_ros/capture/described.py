"""Opening sources from plain descriptions, as they stand in a run's plan and in a launcher's file.

Live cameras; recordings that are played as if they were live; the cameras of a recording, opened together:
frames of each, and depth maps where there are any.
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
    """One camera's frames, and the camera as calibrated for their size.

    Args:
        description: {"kind": "folder" | "file" | "device" | "played", "path" or "device", and what opening
            takes}; of a folder that is played, "rate_hz" and "start_ns" (see `PlayedSource`).

    Raises:
        UserError: as `open_capture_folder`, `open_files` and `open_live`.
    """
    kind = description["kind"]
    options = {k: v for k, v in description.items() if k not in ("kind", "path", "device")}
    if kind == "device":
        return open_live(camera, rig, description["device"], options), rig.camera(camera)
    if kind == "played":
        capture = open_capture_folder(Path(description["path"]), rig=rig, cameras=[camera])
        return PlayedSource(capture.sources[0], options["rate_hz"], options["start_ns"]), rig.camera(camera)
    if kind == "folder":
        capture = open_capture_folder(Path(description["path"]), rig=rig, cameras=[camera], **options)
    elif kind == "file":
        capture = open_files(rig.subset([camera]), {camera: Path(description["path"])}, **options)
    else:
        raise UsageError(f"camera {camera}: there is no source of kind {kind!r}")
    return capture.sources[0], capture.rig.camera(camera)


def open_live(camera: str, rig: Rig, device: str, options: Mapping[str, Any]) -> DeviceSource:
    """A device that gives images of the size for which the camera is calibrated.

    Args:
        options: of `DeviceOptions`, as plain values.

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


OVERTAKEN = 2  # periods after which a frame that was not read is lost, as a device would lose it
MOST_KEPT = 400_000_000  # bytes of frames that are kept of one recording


class PlayedSource:
    """A recording that is played as if it were a live camera: at its rate, over and over.

    Frame n is due, and stamped, at start_ns + n / rate. A short recording is decoded once and played forth
    and back, so that nobody jumps. Its frames are kept as cameras give them (YUV 4:2:0): to turn them into
    BGR is what is left of reading a camera. Of a long one every frame is decoded when it is due, which costs
    what no camera costs, and after the last frame comes the first one.

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


Note = Callable[[Notice], None]


def open_recording(
    rig: Rig, descriptions: Mapping[str, Mapping[str, Any]], stack: ExitStack, note: Note
) -> dict[tuple[str, str], Iterator[Any]]:
    """Iterators of `ViewFrame`s by ("image", camera), and of `DepthFrame`s by ("depth", camera).

    Args:
        descriptions: by camera, see `open_source`.
        stack: closes the files.
        note: takes what is known after the last frame of a camera.

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
