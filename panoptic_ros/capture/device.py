"""Read live cameras through OpenCV: V4L2 devices and RTSP or HTTP streams."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import cv2
import numpy as np

from panoptic_ros.capture.opencv import quiet_opencv
from panoptic_ros.domain import ViewFrame
from panoptic_ros.errors import BackendError, UsageError

Array = np.ndarray
BACKOFF_S = (0.5, 1.0, 2.0, 4.0, 8.0)  # s, pauses between attempts to reconnect
NOMINAL_RATE_HZ = 30.0  # Hz, if a device does not state its rate
STREAM_SCHEMES = ("rtsp", "rtsps", "rtmp", "http", "https", "udp", "tcp")


class Capture(Protocol):
    """The part of cv2.VideoCapture that is used here."""

    def isOpened(self) -> bool: ...  # noqa: N802 - OpenCV's name

    def read(self) -> tuple[bool, Array | None]: ...

    def get(self, which: int) -> float: ...

    def release(self) -> None: ...


@dataclass(frozen=True)
class DeviceOptions:
    """Options for opening a device, and its latency.

    Args:
        image_size: Requested (width, height) px; None = the device's default.
        frame_rate: Requested Hz; None = the device's default.
        latency_ms: Time from mid-exposure to the arrival of the image in this program; it is subtracted from
            the arrival time. About one frame period plus transfer for USB, 100 to 300 ms for RTSP.
        timeout_s: Limit of the time from opening to the first image.
        reconnect: If the images cease, try to reconnect forever; otherwise the source ends.
    """

    image_size: tuple[int, int] | None = None
    frame_rate: float | None = None
    latency_ms: float = 0.0
    timeout_s: float = 10.0
    reconnect: bool = True


class DeviceSource:
    """Newest frame of a live camera.

    A thread reads continuously. An iteration waits for a frame newer than the last one it yielded. Frames in
    between are counted in `dropped`. Frame numbers count all frames that arrived, so gaps are visible. A
    timestamp is the arrival time on `clock` minus the latency, and always increases. If the images cease, the
    device is closed and opened again, with increasing pauses. `reconnects` counts the successful attempts.

    Args:
        camera: Name.
        device: A number, /dev/videoN, or an RTSP or HTTP URL.
        clock: Returns ns; clock of the timestamps, by default the wall clock.
        options: See `DeviceOptions`.
        opener: Replaces OpenCV in tests.

    Raises:
        UsageError: if it is not a device name.
        BackendError: if it cannot be opened, or gives no image within the timeout. While iterating, without
            `reconnect`: if the images cease.
    """

    frame_count: int | None = None

    def __init__(
        self,
        camera: str,
        device: str,
        *,
        clock: Callable[[], int] = time.time_ns,
        options: DeviceOptions | None = None,
        opener: Callable[[str, DeviceOptions], Capture] | None = None,
    ):
        self.camera = camera
        self.device = str(device)
        self.dropped = 0
        self.reconnects = 0
        self._what = f"camera {camera} at {self.device}"
        self._clock = clock
        self._options = options or DeviceOptions()
        self._open = opener or open_device
        check_device(self.device, self._what)
        self._changed = threading.Condition()
        self._newest: ViewFrame | None = None
        self._delivered = True
        self._arrived = 0
        self._last_stamp_ns = -1
        self._failure: str | None = None
        self._rate = self._options.frame_rate or NOMINAL_RATE_HZ
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"capture {camera}", daemon=True)
        self._thread.start()
        self.image_size = self._wait_for_first()
        self.frame_rate = self._rate

    def __iter__(self) -> Iterator[ViewFrame]:
        while True:
            with self._changed:
                while self._delivered and self._failure is None and not self._stop.is_set():
                    self._changed.wait(0.5)
                if self._stop.is_set():
                    return
                if self._delivered:
                    raise BackendError(f"{self._what}: {self._failure}")
                self._delivered = True
                frame = self._newest
            if frame is not None:
                yield frame

    def close(self) -> None:
        """Stop the thread and close the device; iterations end."""
        self._stop.set()
        with self._changed:
            self._changed.notify_all()
        self._thread.join(timeout=5.0)  # timeout: a read that hangs in a driver must not block this program

    def __enter__(self) -> DeviceSource:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def _wait_for_first(self) -> tuple[int, int]:
        deadline = time.monotonic() + self._options.timeout_s
        with self._changed:
            while self._newest is None and self._failure is None:
                left = deadline - time.monotonic()
                if left <= 0:
                    self._failure = f"no image within {self._options.timeout_s:g} s"
                    break
                self._changed.wait(left)
            if self._newest is not None:
                return self._newest.image_size
        self._stop.set()
        raise BackendError(f"{self._what}: {self._failure}; is it connected, permitted, and not in use?")

    def _run(self) -> None:
        """Run the thread: open the device, read until it fails, pause, repeat."""
        attempt = 0
        while not self._stop.is_set():
            with quiet_opencv():
                capture = self._open(self.device, self._options)
            try:
                count = self._read_all(capture) if capture.isOpened() else 0
            finally:
                capture.release()
            if self._stop.is_set():
                return
            ever = self._newest is not None
            if not ever or not self._options.reconnect:
                self._fail("it sends no more images" if ever else "it cannot be opened or sends no image")
                return
            attempt = 0 if count else attempt + 1
            self._stop.wait(BACKOFF_S[min(attempt, len(BACKOFF_S) - 1)])

    def _read_all(self, capture: Capture) -> int:
        """Read images until the device fails; return their number."""
        count = 0
        while not self._stop.is_set():
            with quiet_opencv():
                good, image = capture.read()
            arrival = self._clock()
            if not good or image is None:
                break
            if count == 0:
                rate = capture.get(cv2.CAP_PROP_FPS)
                self._rate = rate if 1.0 <= rate <= 1000.0 else self._rate
                self.reconnects += self._newest is not None
            count += 1
            self._publish(image, arrival)
        return count

    def _publish(self, image: Array, arrival_ns: int) -> None:
        stamp = max(arrival_ns - round(1e6 * self._options.latency_ms), self._last_stamp_ns + 1, 0)
        frame = ViewFrame(self.camera, stamp, self._arrived, image)
        with self._changed:
            self.dropped += not self._delivered
            self._newest, self._delivered = frame, False
            self._last_stamp_ns = stamp
            self._arrived += 1
            self._changed.notify_all()

    def _fail(self, why: str) -> None:
        with self._changed:
            self._failure = why
            self._changed.notify_all()


def check_device(device: str, what: str) -> None:
    """Check that a name can be a device.

    Raises:
        UsageError: if it is neither a number, nor a path in /dev, nor a URL of a stream.
        BackendError: if it is a path that does not exist.
    """
    scheme, mark, _ = device.partition("://")
    if device.isdecimal() or (mark and scheme.lower() in STREAM_SCHEMES):
        return
    if not device.startswith("/dev/"):
        raise UsageError(f"{what}: a device is a number, /dev/videoN, or an rtsp:// or http:// address")
    if not Path(device).exists():
        raise BackendError(f"{what}: no such device; `ls /dev/video*` lists the available ones")


def open_device(device: str, options: DeviceOptions) -> cv2.VideoCapture:
    """Return OpenCV's capture of a device or stream; check isOpened() afterwards."""
    if "://" in device:
        milliseconds = round(1000 * options.timeout_s)
        capture = cv2.VideoCapture(
            device,
            cv2.CAP_FFMPEG,
            [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, milliseconds, cv2.CAP_PROP_READ_TIMEOUT_MSEC, milliseconds],
        )
    else:
        capture = cv2.VideoCapture(int(device) if device.isdecimal() else device, cv2.CAP_V4L2)
    if capture.isOpened():
        if options.image_size is not None:
            # most USB cameras reach their full rate at large sizes only as MJPEG
            capture.set(cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*"MJPG"))
            capture.set(cv2.CAP_PROP_FRAME_WIDTH, options.image_size[0])
            capture.set(cv2.CAP_PROP_FRAME_HEIGHT, options.image_size[1])
        if options.frame_rate is not None:
            capture.set(cv2.CAP_PROP_FPS, options.frame_rate)
        capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)
    return capture
