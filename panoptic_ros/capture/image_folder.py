"""Folders of numbered images."""
from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np

from panoptic_ros.capture.opencv import quiet_opencv
from panoptic_ros.capture.source import check_stamps, exact_rate, grid_stamp
from panoptic_ros.domain import ViewFrame
from panoptic_ros.errors import DataError
from panoptic_ros.io.loading import read_bytes
from panoptic_ros.io.pictures import decode_picture, picture_size

UNSEEN = 16_000_000  # pixels of a first image that is decoded before its size is compared with the rig's
LARGEST_IMAGE = 1 << 30  # bytes of a file
IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg")


class ImageFolderSource:
    """The images of a folder in natural order of their names: 2.png before 10.png.

    Iterating starts at the first image every time; images are read one by one. Frame numbers
    count the files from 0, whatever numbers their names have.

    Args:
        camera: name.
        path: folder with PNG or JPEG files; others in it are ignored.
        start_ns: stamp of the first image, ns.
        frame_rate: Hz, image i is at start_ns + i / frame_rate.
        stamps: ns, one per image, in place of the frame rate.

    Raises:
        DataError: no folder, no images; while iterating: an image that cannot be read or has another
            size than the first.
    """

    def __init__(
        self,
        camera: str,
        path: Path,
        *,
        start_ns: int = 0,
        frame_rate: float = 30.0,
        stamps: Sequence[int] | None = None,
    ):
        self.camera = camera
        self.path = Path(path)
        self._what = f"image folder {self.path} of camera {camera}"
        self.files = image_files(self.path)
        if not self.files:
            raise DataError(f"{self._what} has no PNG or JPEG images")
        self._start_ns = int(start_ns)
        self._rate = exact_rate(frame_rate, self._what)
        self.frame_rate = float(self._rate)
        self._stamps = None if stamps is None else check_stamps(stamps, self._what)
        if self._stamps is not None and len(self._stamps) != len(self.files):
            raise DataError(f"{self._what} has {len(self.files)} images but {len(self._stamps)} stamps")
        self.frame_count: int | None = len(self.files)
        self.image_size = _first_size(self.files[0])
        self._closed = False

    def __iter__(self) -> Iterator[ViewFrame]:
        self._closed = False
        for number, file in enumerate(self.files):
            if self._closed:
                return
            image = _read_image(file, self.image_size)
            if (image.shape[1], image.shape[0]) != self.image_size:
                raise DataError(
                    f"image {file} is {image.shape[1]}x{image.shape[0]}, "
                    f"the first of its folder {self.image_size[0]}x{self.image_size[1]}"
                )
            yield ViewFrame(self.camera, self._stamp(number), number, image)

    def _stamp(self, number: int) -> int:
        if self._stamps is not None:
            return self._stamps[number]
        return grid_stamp(self._start_ns, number, self._rate)

    def close(self) -> None:
        """End iterations that are under way."""
        self._closed = True

    def __enter__(self) -> ImageFolderSource:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


def image_files(path: Path) -> tuple[Path, ...]:
    """The images directly in a folder, in natural order; none if it is no folder."""
    if not path.is_dir():
        return ()
    found = (p for p in path.iterdir() if p.suffix.lower() in IMAGE_SUFFIXES and not p.name.startswith("."))
    return tuple(sorted(found, key=lambda p: natural_key(p.name)))


def natural_key(name: str) -> tuple[tuple[int, int, str], ...]:
    """A key that sorts names as people do: digits as numbers, and the rest by its letters."""
    parts = re.findall(r"\d+|\D+", name)
    # the last entry orders names that differ in leading zeros only
    return (*((0, int(p), "") if p.isdecimal() else (1, 0, p.casefold()) for p in parts), (2, 0, name))


def _first_size(file: Path) -> tuple[int, int]:
    """Return the size of the first image in px; a large one is not decoded."""
    size = picture_size(read_bytes(file, LARGEST_IMAGE))
    if size is not None and size[0] * size[1] > UNSEEN:
        return size
    image = _read_image(file, None)
    return image.shape[1], image.shape[0]


def _read_image(file: Path, expected: tuple[int, int] | None) -> np.ndarray:
    """Return an image (h, w, 3) uint8 BGR, decoded only if its header allows the expected size."""
    data = np.frombuffer(read_bytes(file, LARGEST_IMAGE), np.uint8)
    size = picture_size(data.tobytes())
    if expected is not None and size is not None and sorted(size) != sorted(expected):
        raise DataError(
            f"image {file} is {size[0]}x{size[1]}, the first of its folder {expected[0]}x{expected[1]}"
        )
    with quiet_opencv():
        image = decode_picture(data, cv2.IMREAD_COLOR, f"image {file}")
    if image is None:
        raise DataError(f"{file} is no image that can be decoded; make it again or remove it")
    return image
