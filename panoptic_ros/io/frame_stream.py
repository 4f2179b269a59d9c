"""A gzipped JSON document with many frames, frame by frame: hours need no more memory than minutes."""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from panoptic_ros.io.files import file_errors

GZIP = 31  # zlib's number for a gzip file


class FrameStream:
    """Writes {..., "frames": [...]}.

    Args:
        head: all that stands before the frames.

    Raises:
        EnvironmentProblem: if the file cannot be written.
    """

    def __init__(self, path: Path, head: Mapping[str, Any]):
        self._path = path
        self._packer = zlib.compressobj(9, zlib.DEFLATED, GZIP)
        self.count = 0
        with file_errors(path, "write"):
            self._file = path.open("wb")
        self._write(json.dumps({**head, "frames": []}).removesuffix("]}"))

    def add(self, frame: Mapping[str, Any]) -> None:
        """One more frame."""
        self._write((", " if self.count else "") + json.dumps(frame, allow_nan=False))
        self.count += 1

    def close(self) -> None:
        """Finish the file."""
        self._write("]}\n")
        with file_errors(self._path, "write"):
            self._file.write(self._packer.flush())
            self._file.close()

    def discard(self) -> None:
        """Give the file up."""
        self._file.close()

    def _write(self, text: str) -> None:
        data: Any = self._packer.compress(text.encode())
        with file_errors(self._path, "write"):
            self._file.write(data)
