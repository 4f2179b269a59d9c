"""Pictures in files, whole or not at all."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from panoptic_ros.errors import DataError, UsageError
from panoptic_ros.io.files import write_bytes

Array = np.ndarray


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
