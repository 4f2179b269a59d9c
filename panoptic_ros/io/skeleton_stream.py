"""skeletons.json.gz frame by frame: a run of hours needs no more memory than one of minutes."""
from __future__ import annotations

import json
import zlib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from panoptic_ros.domain import TrackedPoseSet
from panoptic_ros.io.files import file_errors
from panoptic_ros.io.plain_formats import SKELETONS, skeletons_frame

GZIP = 31  # zlib's number for a gzip file


class SkeletonStream:
    """The bytes are those of `io.plain_formats.write_skeletons`, gzipped whatever the name.

    Raises:
        EnvironmentProblem: if the file cannot be written.
    """

    def __init__(self, path: Path, joint_names: Iterable[str]):
        self._path = path
        self._packer = zlib.compressobj(9, zlib.DEFLATED, GZIP)
        self.count = 0
        with file_errors(path, "write"):
            self._file = path.open("wb")
        head = json.dumps({"format": SKELETONS, "joint_names": list(joint_names), "frames": []})
        self._write(head.removesuffix("]}"))

    def add(self, item: TrackedPoseSet) -> None:
        """One more frame."""
        self._write((", " if self.count else "") + json.dumps(skeletons_frame(item), allow_nan=False))
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
