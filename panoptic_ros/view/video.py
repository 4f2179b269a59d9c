"""Pictures and videos in files, whole or not at all."""
from __future__ import annotations

import os
from pathlib import Path

import cv2
import numpy as np

from panoptic_ros.capture.opencv import quiet_opencv
from panoptic_ros.errors import ConfigError, DataError, EnvironmentProblem, UsageError
from panoptic_ros.io.files import file_errors, write_bytes

Array = np.ndarray
# OpenCV's wheels bring FFmpeg without an H.264 encoder. MPEG-4 Part 2 is quick (4 ms per frame of
# 1224x720) and VLC, mpv, QuickTime, Windows and editors play it; browsers do not. VP9 plays in browsers but
# takes 80 times as long.
CODECS = {"mpeg4": "mp4v", "vp9": "vp09", "h264": "avc1"}


class OverlayVideo:
    """Writes an MP4 file; it appears under its name when it is complete, and only then.

    A context manager: leaving it normally closes the file, leaving it with an exception discards it.
    Without a single frame no file is made.

    Args:
        path: ends in .mp4.
        size: (width, height) px, even.
        frame_rate: Hz.
        codec: mpeg4, or vp9 for browsers (slow), or h264 where OpenCV has it.

    Raises:
        UsageError, ConfigError: for impossible arguments.
        EnvironmentProblem: if the file cannot be written, or turns out to be damaged (a full disk).
    """

    def __init__(self, path: Path, size: tuple[int, int], frame_rate: float, codec: str = "mpeg4"):
        self.path = Path(path)
        self.size = (int(size[0]), int(size[1]))
        self.frame_count = 0
        if self.path.suffix.lower() != ".mp4":
            raise UsageError(f"a video is written as .mp4, not {self.path.name}")
        if codec not in CODECS:
            raise ConfigError(f"unknown video codec {codec!r}; there are {', '.join(CODECS)}")
        if min(self.size) < 2 or self.size[0] % 2 or self.size[1] % 2 or not 0.01 <= frame_rate <= 1000.0:
            raise UsageError(f"a video of {size[0]}x{size[1]} px at {frame_rate} Hz; px must be even")
        self._temporary = self.path.with_name(f".{self.path.stem}.{os.getpid()}.part.mp4")
        with file_errors(self.path, "write"):
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._temporary.touch()  # FFmpeg does not say why it fails; this does
        with quiet_opencv():
            fourcc = cv2.VideoWriter.fourcc(*CODECS[codec])
            self._writer: cv2.VideoWriter | None = cv2.VideoWriter(
                str(self._temporary), cv2.CAP_FFMPEG, fourcc, float(frame_rate), self.size
            )
        if not self._writer.isOpened():
            self.discard()
            raise EnvironmentProblem(f"OpenCV cannot write {codec} video here; choose another codec")

    def write(self, image: Array) -> None:
        """Add a picture (H, W, 3) uint8, BGR.

        Raises:
            DataError: if it has another size or type than the video.
        """
        if self._writer is None:
            raise UsageError(f"{self.path} is closed already")
        if image.shape != (self.size[1], self.size[0], 3) or image.dtype != np.uint8:
            raise DataError(f"{image.dtype} {image.shape} for a video of {self.size[0]}x{self.size[1]}")
        with quiet_opencv():
            self._writer.write(image)
        self.frame_count += 1

    def close(self) -> None:
        """Finish the file; does nothing the second time."""
        if self._writer is None:
            return
        self._release()
        try:
            if self.frame_count:
                self._check()
                with file_errors(self.path, "write"):
                    os.replace(self._temporary, self.path)
        finally:
            self.discard()

    def discard(self) -> None:
        """Give up: nothing is left."""
        self._release()
        self._temporary.unlink(missing_ok=True)

    def _release(self) -> None:
        if self._writer is not None:
            with quiet_opencv():
                self._writer.release()
            self._writer = None

    def _check(self) -> None:
        """FFmpeg reports no failed write through OpenCV, so look at what was written."""
        with quiet_opencv():
            capture = cv2.VideoCapture(str(self._temporary))
            count = int(capture.get(cv2.CAP_PROP_FRAME_COUNT)) if capture.isOpened() else 0
            good = count == self.frame_count and capture.read()[0]
            capture.release()
        if not good:
            raise EnvironmentProblem(
                f"cannot write {self.path}: {count} of {self.frame_count} frames arrived; is the disk full?"
            )

    def __enter__(self) -> OverlayVideo:
        return self

    def __exit__(self, kind: type[BaseException] | None, *rest: object) -> None:
        if kind is None:
            self.close()
        else:
            self.discard()


def write_image(path: Path, image: Array) -> None:
    """Write a picture (H, W, 3) uint8, BGR as PNG or JPEG, by its name's ending.

    Raises:
        UsageError: for other endings.
        EnvironmentProblem: if it cannot be written.
    """
    path = Path(path)
    options = {".png": [], ".jpg": [cv2.IMWRITE_JPEG_QUALITY, 90], ".jpeg": [cv2.IMWRITE_JPEG_QUALITY, 90]}
    if path.suffix.lower() not in options:
        raise UsageError(f"pictures are written as .png or .jpg, not {path.name}")
    good, data = cv2.imencode(path.suffix.lower(), image, options[path.suffix.lower()])
    if not good:
        raise DataError(f"{image.dtype} {image.shape} cannot be written as {path.name}")
    write_bytes(path, data.tobytes())


class Stills:
    """Pictures at given instants: of each, the first picture offered at or after it.

    Args:
        folder: for the files overlay_<seconds since the first picture>s.png.
        instants_s: seconds since the first picture.
        suffix: .png or .jpg.
    """

    def __init__(self, folder: Path, instants_s: tuple[float, ...], suffix: str = ".png"):
        self.folder = Path(folder)
        self.written: list[Path] = []
        self._suffix = suffix
        self._waiting = sorted(instants_s)
        self._first_ns: int | None = None
        self._last: tuple[float, Array] | None = None

    def offer(self, stamp_ns: int, image: Array) -> None:
        """The picture of a later instant than all before."""
        if self._first_ns is None:
            self._first_ns = stamp_ns
        seconds = (stamp_ns - self._first_ns) / 1e9
        self._last = (seconds, image)
        if self._waiting and self._waiting[0] <= seconds + 1e-9:
            self._waiting = [instant for instant in self._waiting if instant > seconds + 1e-9]
            self._write(seconds, image)

    def close(self) -> None:
        """Instants after the last picture get the last picture."""
        if self._waiting and self._last is not None:
            self._waiting = []
            self._write(*self._last)

    def _write(self, seconds: float, image: Array) -> None:
        path = self.folder / f"overlay_{seconds:07.3f}s{self._suffix}"
        if path not in self.written:
            write_image(path, image)
            self.written.append(path)
