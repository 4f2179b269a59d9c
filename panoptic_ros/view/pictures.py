"""Image files, written atomically."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from panoptic_ros.errors import DataError, UsageError
from panoptic_ros.io.files import write_bytes

Array = np.ndarray


def write_image(path: Path, image: Array) -> None:
    """Write a BGR image (H, W, 3) uint8 as PNG or JPEG, depending on the file suffix.

    Raises:
        UsageError: For other suffixes.
        EnvironmentProblem: If the file cannot be written.
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
    """Stills at given instants: for each instant, the first picture offered at or after it.

    Args:
        folder: Folder of the files overlay_<seconds since the first picture>s.png.
        instants_s: Instants in s since the first picture.
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
        """Offer the next picture; pictures must come in the order of time."""
        if self._first_ns is None:
            self._first_ns = stamp_ns
        seconds = (stamp_ns - self._first_ns) / 1e9
        self._last = (seconds, image)
        if self._waiting and self._waiting[0] <= seconds + 1e-9:
            self._waiting = [instant for instant in self._waiting if instant > seconds + 1e-9]
            self._write(seconds, image)

    def close(self) -> None:
        """Write the last picture for instants that lie after it."""
        if self._waiting and self._last is not None:
            self._waiting = []
            self._write(*self._last)

    def _write(self, seconds: float, image: Array) -> None:
        path = self.folder / f"overlay_{seconds:07.3f}s{self._suffix}"
        if path not in self.written:
            write_image(path, image)
            self.written.append(path)
