"""MP4 files of JPEG pictures: good quality, exact frame rate, equal pictures give equal bytes.

OpenCV's wheels write MPEG-4 only, whose quality cannot be set and which smears faces at VGA size. Motion
JPEG needs no encoder but `imencode`; FFmpeg, OpenCV, VLC and mpv read it. The container follows
the QuickTime File Format Specification (Apple 2001): ftyp, mdat with the pictures, moov with their sizes.
"""
from __future__ import annotations

import os
import struct
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO

import cv2
import numpy as np

from panoptic_ros.errors import DataError, UsageError
from panoptic_ros.io.files import file_errors

Array = np.ndarray
TICKS_PER_FRAME = 1000
_MATRIX = struct.pack(">9i", 0x10000, 0, 0, 0, 0x10000, 0, 0, 0, 0x40000000)
_FILE_TYPE = (b"qt  ", struct.pack(">I", 0x200), b"qt  ")


class MotionJpegWriter:
    """Writes a video that appears under its name when it is complete, and only then.

    A context manager: leaving it normally closes the file, leaving it with an exception discards it.

    Args:
        path: ends in .mp4 or .mov.
        size: (width, height) px.
        frame_rate: Hz, exact to 0.001.
        quality: of the JPEG pictures, 1..100.

    Raises:
        UsageError: for impossible arguments.
        EnvironmentProblem: if the file cannot be written.
    """

    def __init__(self, path: Path, size: tuple[int, int], frame_rate: float, quality: int = 92):
        self.path = Path(path)
        self.size = (int(size[0]), int(size[1]))
        if not 0.01 <= frame_rate <= 1000.0 or not 1 <= quality <= 100 or min(self.size) < 1:
            raise UsageError(f"no video of {size[0]}x{size[1]} px, {frame_rate} Hz, quality {quality}")
        self._timescale = round(TICKS_PER_FRAME * frame_rate)
        self._quality = quality
        self._sizes: list[int] = []
        self._temporary = self.path.with_name(f".{self.path.stem}.{os.getpid()}.part")
        with file_errors(self.path, "write"):
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._file: BinaryIO | None = open(self._temporary, "wb")
            self._file.write(_box(b"ftyp", *_FILE_TYPE))
            self._data_at = self._file.tell()
            self._file.write(struct.pack(">I4sQ", 1, b"mdat", 0))  # its size comes at the end

    def write(self, image: Array) -> None:
        """Add a picture (H, W, 3) uint8, BGR.

        Raises:
            DataError: if it has another size or type than the video.
        """
        if self._file is None:
            raise UsageError(f"{self.path} is closed already")
        if image.shape != (self.size[1], self.size[0], 3) or image.dtype != np.uint8:
            raise DataError(f"{image.dtype} {image.shape} for a video of {self.size[0]}x{self.size[1]}")
        _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, self._quality])
        with file_errors(self.path, "write"):
            self._file.write(data.tobytes())
        self._sizes.append(data.size)

    def close(self) -> None:
        """Finish the file; does nothing the second time.

        Raises:
            DataError: if it has no pictures.
        """
        if self._file is None:
            return
        if not self._sizes:
            self.discard()
            raise DataError(f"{self.path}: a video without pictures")
        try:
            with file_errors(self.path, "write"):
                end = self._file.tell()
                self._file.write(self._index())
                self._file.seek(self._data_at + 8)
                self._file.write(struct.pack(">Q", end - self._data_at))
                self._file.close()
                os.replace(self._temporary, self.path)
        finally:
            self.discard()

    def discard(self) -> None:
        """Give up: nothing is left."""
        if self._file is not None:
            with suppress(OSError):  # a full disk fails again here, and the content is not wanted
                self._file.close()
            self._file = None
        self._temporary.unlink(missing_ok=True)

    def __enter__(self) -> MotionJpegWriter:
        return self

    def __exit__(self, kind: type[BaseException] | None, *rest: object) -> None:
        if kind is None:
            self.close()
        else:
            self.discard()

    def _index(self) -> bytes:
        """The moov box: one track of JPEG pictures that lie one after another."""
        count, (width, height) = len(self._sizes), self.size
        duration, times = count * TICKS_PER_FRAME, bytes(8)  # made and changed: not told
        start = self._data_at + 16
        places = start + np.concatenate([[0], np.cumsum(self._sizes[:-1], dtype=np.int64)])
        picture = struct.pack(
            ">6xH16xHHIIIH32sHh", 1, width, height, 72 << 16, 72 << 16, 0, 1, b"\x04JPEG", 24, -1
        )
        table = _box(
            b"stbl",
            _box(b"stsd", struct.pack(">II", 0, 1), _box(b"jpeg", picture)),
            _box(b"stts", struct.pack(">IIII", 0, 1, count, TICKS_PER_FRAME)),
            _box(b"stsc", struct.pack(">IIIII", 0, 1, 1, 1, 1)),
            _box(b"stsz", struct.pack(">III", 0, 0, count), struct.pack(f">{count}I", *self._sizes)),
            _box(b"co64", struct.pack(">II", 0, count), struct.pack(f">{count}Q", *places.tolist())),
        )
        source = _box(b"dinf", _box(b"dref", struct.pack(">II", 0, 1), _box(b"url ", bytes([0, 0, 0, 1]))))
        media = _box(
            b"mdia",
            _box(b"mdhd", struct.pack(">I8sIIHH", 0, times, self._timescale, duration, 0, 0)),
            _box(b"hdlr", struct.pack(">I4s4s12xB", 0, b"mhlr", b"vide", 0)),
            _box(b"minf", _box(b"vmhd", struct.pack(">IHHHH", 1, 0, 0, 0, 0)), source, table),
        )
        shown = struct.pack(">I8sIII8xHHHH", 3, times, 1, 0, duration, 0, 0, 0, 0)
        track = _box(b"tkhd", shown, _MATRIX, struct.pack(">II", width << 16, height << 16))
        movie = struct.pack(">I8sIIIH10x", 0, times, self._timescale, duration, 0x10000, 0x100)
        header = _box(b"mvhd", movie, _MATRIX, bytes(24), struct.pack(">I", 2))
        return _box(b"moov", header, _box(b"trak", track, media))


def _box(kind: bytes, *parts: bytes) -> bytes:
    content = b"".join(parts)
    return struct.pack(">I4s", 8 + len(content), kind) + content
