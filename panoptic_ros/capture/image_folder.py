"""Read folders of numbered images."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from fractions import Fraction
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np

from panoptic_ros.capture.opencv import quiet_opencv
from panoptic_ros.capture.source import check_stamps, exact_rate, grid_stamp
from panoptic_ros.capture.starts import TimecodeLabel
from panoptic_ros.domain import ViewFrame
from panoptic_ros.errors import DataError
from panoptic_ros.io.loading import read_bytes
from panoptic_ros.io.pictures import decode_picture, picture_size
from panoptic_ros.stage import Notice

# px; a larger first image is not decoded before its size is compared with the rig's.
UNSEEN = 16_000_000
LARGEST_IMAGE = 1 << 30  # bytes of a file
IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp")
MOST_SHOWN = 3  # gaps listed in a notice
DIGITS = 18  # digits of an image's number, which is a 64-bit integer


class ImageFolderSource:
    """Images of a folder in natural order of their names: 2.png before 10.png.

    Every iteration starts at the first image; images are read one by one. Frame numbers count the files from
    0, independent of the numbers in their names. Without timestamps, a number that the names skip is a
    missing frame, and `notices` reports it.

    Args:
        camera: Name.
        path: Folder with images (`IMAGE_SUFFIXES`); other files in it are ignored.
        start_ns: Timestamp of the first image, ns. The attribute may be changed when the start is found
            later.
        frame_rate: Hz; image i has the timestamp start_ns + i / frame_rate, where i includes missing numbers.
        stamps: Timestamps (ns), one per image; they replace the frame rate.
        tabled: An external table has the timestamps, so the numbers in the names are ignored.
        skip_damaged: Skip and count images that cannot be decoded, instead of an error.

    Attributes:
        first: Number of the first image; None if the names have no frame numbers.
        step: Difference between the numbers of successive images; 1 if the names have no frame numbers.
        late, label: as in `VideoSource`; always 0 and None.
        notices: Lines without the camera name.
        after: Notices that are available after the last image.

    Raises:
        DataError: if the folder or images are missing; while iterating, if an image cannot be read or has
            another size than the first.
    """

    def __init__(
        self,
        camera: str,
        path: Path,
        *,
        start_ns: int = 0,
        frame_rate: float = 30.0,
        stamps: Sequence[int] | None = None,
        tabled: bool = False,
        skip_damaged: bool = False,
    ):
        self.camera = camera
        self.path = Path(path)
        self._what = f"image folder {self.path} of camera {camera}"
        self.files = image_files(self.path)
        if not self.files:
            raise DataError(f"{self._what} has no images ({', '.join(s[1:] for s in IMAGE_SUFFIXES)})")
        self.start_ns = int(start_ns)
        self._rate = exact_rate(frame_rate, self._what)
        self.frame_rate = float(self._rate)
        self._stamps = None if stamps is None else check_stamps(stamps, self._what)
        if self._stamps is not None and len(self._stamps) != len(self.files):
            raise DataError(f"{self._what} has {len(self.files)} images but {len(self._stamps)} stamps")
        self._skip = skip_damaged
        self.late = Fraction(0)
        self.label: TimecodeLabel | None = None
        self.first: int | None = None
        self.step = 1
        self.notices: tuple[str, ...] = ()
        self.after: tuple[Notice, ...] = ()
        self._places = list(range(len(self.files)))  # frame periods since the first image
        if self._stamps is None and not tabled:
            self._number()
        self.frame_count: int | None = len(self.files)
        self.image_size = self._first_size()
        self._closed = False

    def __iter__(self) -> Iterator[ViewFrame]:
        self._closed, self.after = False, ()
        damaged = 0
        for number, file in enumerate(self.files):
            if self._closed:
                return
            image = self._read(file, self.image_size)
            if image is None:
                damaged += 1
                continue
            if (image.shape[1], image.shape[0]) != self.image_size:
                raise DataError(
                    f"image {file} is {image.shape[1]}x{image.shape[0]}, "
                    f"the first of its folder {self.image_size[0]}x{self.image_size[1]}"
                )
            yield ViewFrame(self.camera, self._stamp(number), number, image)
        if damaged:
            text = f"{self.path}: {damaged} of {len(self.files)} images are damaged and left out"
            self.after = (Notice("source.damaged", "warning", text, {"device": self.camera}),)

    def _number(self) -> None:
        """Derive the positions in time from the numbers in the names, if these are frame numbers."""
        numbers = image_numbers([file.stem for file in self.files])
        if not numbers:
            return
        steps = [after - before for before, after in pairwise(numbers)]
        step, often = Counter(steps).most_common(1)[0] if steps else (1, 1)
        if step <= 0 or any(size % step for size in steps) or 2 * often < len(steps):
            self.notices = (
                "numbers of images are uneven: images are taken one after another; give timestamps.csv",
            )
            return
        self.first, self.step = numbers[0], step
        self._places = [(number - numbers[0]) // step for number in numbers]
        gaps = [(before, after) for before, after in pairwise(numbers) if after - before != step]
        if gaps:
            said = ", ".join(
                f"{before + step} to {after - step}" if after - before > 2 * step else f"{before + step}"
                for before, after in gaps[:MOST_SHOWN]
            ) + (", ..." if len(gaps) > MOST_SHOWN else "")
            lost = self._places[-1] + 1 - len(numbers)
            self.notices = (
                f"{lost} image numbers are missing ({said}): the other images keep the places of their "
                "numbers",
            )

    def _stamp(self, number: int) -> int:
        if self._stamps is not None:
            return self._stamps[number]
        return grid_stamp(self.start_ns, self._places[number], self._rate)

    def _first_size(self) -> tuple[int, int]:
        """Return the size (px) of the first image that can be decoded; a large image is not decoded."""
        for file in self.files:
            size = picture_size(read_bytes(file, LARGEST_IMAGE))
            if size is not None and size[0] * size[1] > UNSEEN:
                return size
            image = self._read(file, None)
            if image is not None:
                return image.shape[1], image.shape[0]
        raise DataError(f"{self._what}: no image can be decoded; make them again")

    def _read(self, file: Path, expected: tuple[int, int] | None) -> np.ndarray | None:
        """Read an image (h, w, 3) uint8 BGR; None if it is damaged and `skip_damaged` is set."""
        image = _read_image(file, expected)
        if image is None and not self._skip:
            raise DataError(
                f"{file} is not an image that can be decoded; make it again or remove it, or --skip-damaged "
                "leaves it out"
            )
        return image

    def close(self) -> None:
        """End running iterations."""
        self._closed = True

    def __enter__(self) -> ImageFolderSource:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


def image_files(path: Path) -> tuple[Path, ...]:
    """Return the images directly in a folder, in natural order; empty if it is not a folder."""
    if not path.is_dir():
        return ()
    found = (p for p in path.iterdir() if p.suffix.lower() in IMAGE_SUFFIXES and not p.name.startswith("."))
    return tuple(sorted(found, key=lambda p: natural_key(p.name)))


def image_numbers(stems: Sequence[str]) -> list[int]:
    """Return the number in each name, if the names differ in one number only; else []."""
    parts = [re.findall(r"\d+|\D+", stem) for stem in stems]
    if len({len(own) for own in parts}) != 1:
        return []
    varying = [column for column in zip(*parts) if len(set(column)) > 1]
    if len(varying) != 1 or not all(word.isdecimal() and len(word) <= DIGITS for word in varying[0]):
        return []
    return [int(word) for word in varying[0]]


def natural_key(name: str) -> tuple[tuple[int, int, str], ...]:
    """Return a sort key for natural order: digits as numbers, other text without case."""
    parts = re.findall(r"\d+|\D+", name)
    # the last entry orders names that differ in leading zeros only
    return (*((0, int(p), "") if p.isdecimal() else (1, 0, p.casefold()) for p in parts), (2, 0, name))


def _read_image(file: Path, expected: tuple[int, int] | None) -> np.ndarray | None:
    """Read an image (h, w, 3) uint8 BGR; None if it cannot be decoded.

    Raises:
        DataError: if its header has another size than expected; it is then not decoded.
    """
    data = np.frombuffer(read_bytes(file, LARGEST_IMAGE), np.uint8)
    size = picture_size(data.tobytes())
    if expected is not None and size is not None and sorted(size) != sorted(expected):
        raise DataError(
            f"image {file} is {size[0]}x{size[1]}, the first of its folder {expected[0]}x{expected[1]}"
        )
    with quiet_opencv():
        return decode_picture(data, cv2.IMREAD_COLOR, f"image {file}")
