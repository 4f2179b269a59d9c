"""Write single images of several cameras as a capture folder: every file is whole at any time."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from panoptic_ros.errors import DataError
from panoptic_ros.io.files import file_errors, write_bytes
from panoptic_ros.io.stamps import NAMES, OWN


class RecordedImage(NamedTuple):
    """Image file of a camera: its stamp, ns, its suffix, e.g. ".png", and its bytes."""

    stamp_ns: int
    suffix: str
    data: bytes


class ImageRecorder:
    """Recorder of images as `<camera>/<number>.png|jpg` with timestamps.csv.

    An image appears under its name after its row in the table. A crash between both leaves one row too many,
    never a broken file.

    Args:
        path: Folder; the first images make it.

    Raises:
        DataError: if it exists already, because recordings are never overwritten.
    """

    def __init__(self, path: Path):
        self.path = path
        if os.path.lexists(path):
            raise DataError(
                f"{path} exists already, and recordings stay; give another --out, or move it away"
            )
        self._counts: Counter[str] = Counter()
        self._rows = [",".join(OWN)]

    @property
    def counts(self) -> Mapping[str, int]:
        """Return the number of images by camera."""
        return dict(self._counts)

    def add(self, images: Mapping[str, RecordedImage]) -> None:
        """Write images by camera.

        Raises:
            EnvironmentProblem: if the disk is full; nothing of `images` is kept then.
        """
        hidden: list[tuple[Path, Path]] = []
        rows = []
        with file_errors(self.path, "write"):
            try:
                for camera, image in images.items():
                    number = self._counts[camera]
                    place = self.path / camera / f"{number:06d}{image.suffix}"
                    place.parent.mkdir(parents=True, exist_ok=True)
                    hidden.append((place.with_name(f".{place.name}"), place))
                    hidden[-1][0].write_bytes(image.data)
                    rows.append(f"{camera},{number},{image.stamp_ns}")
                write_bytes(self.path / NAMES[0], "\n".join([*self._rows, *rows, ""]).encode())
            except BaseException:
                for temporary, _ in hidden:
                    temporary.unlink(missing_ok=True)
                raise
            for temporary, place in hidden:
                os.replace(temporary, place)
        self._rows += rows
        for camera in images:
            self._counts[camera] += 1
