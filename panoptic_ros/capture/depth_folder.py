"""Read depth maps registered to a camera's images, from a folder of 16-bit PNGs."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from panoptic_ros.capture.image_folder import ImageFolderSource, natural_key
from panoptic_ros.capture.opencv import quiet_opencv
from panoptic_ros.capture.timed import CorrectedSource, TimedSource
from panoptic_ros.capture.video import VideoSource
from panoptic_ros.domain import DepthFrame, ViewFrame
from panoptic_ros.errors import DataError
from panoptic_ros.io.loading import read_bytes
from panoptic_ros.io.pictures import decode_picture
from panoptic_ros.stage import Notice

# px limit of a depth map, 300 MB with the map in metres. Sensors have 1 Mpx.
MOST_PIXELS = 50_000_000
SUFFIX = "_depth"


def depth_files(folder: Path, camera: str) -> tuple[Path, ...]:
    """Return the PNGs of `<camera>_depth/` in natural order; empty if the folder does not exist.

    Args:
        camera: name of a camera or depth sensor.
    """
    place = folder / f"{camera}{SUFFIX}"
    if not place.is_dir():
        return ()
    files = (p for p in place.iterdir() if p.suffix.lower() == ".png" and not p.name.startswith("."))
    return tuple(sorted(files, key=lambda path: natural_key(path.name)))


class DepthSource:
    """Source of a camera whose frames have depth maps: the n-th file belongs to frame n.

    Args:
        source: source of the images.
        files: uint16 mm along the camera's z axis, 0 = unknown, with the image's field of view.
        frames: number of frames in the camera's file; None = unknown. `source` may skip frames without a
            timestamp.

    Raises:
        DataError: if the number of files differs from the number of frames.
    """

    def __init__(
        self,
        source: VideoSource | ImageFolderSource | TimedSource | CorrectedSource,
        files: tuple[Path, ...],
        frames: int | None,
    ):
        self._source, self._files = source, files
        self.camera, self.path, self.image_size = source.camera, source.path, source.image_size
        self.frame_rate, self.frame_count = source.frame_rate, source.frame_count
        if frames is not None and frames != len(files):
            raise DataError(
                f"{files[0].parent} has {len(files)} depth maps for the {frames} frames of camera "
                f"{self.camera}; make it one for each, or remove the folder"
            )

    def __iter__(self) -> Iterator[ViewFrame]:
        yield from self._source

    def depth_of(self, frame: ViewFrame) -> DepthFrame:
        """Return the depth map of a frame.

        Raises:
            DataError: if it is missing, or its file is not a depth map of the frame's image.
        """
        number = frame.frame_number
        if number >= len(self._files):
            raise DataError(f"{self._files[0].parent} has no depth map for frame {number}")
        found = DepthFrame(frame.camera, frame.stamp_ns, number, read_depth(self._files[number]))
        found.check_image(frame.image_size)
        return found

    @property
    def after(self) -> tuple[Notice, ...]:
        """Return the notices that are available after the last frame."""
        return self._source.after

    def close(self) -> None:
        """Close the images."""
        self._source.close()

    def __enter__(self) -> DepthSource:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


def read_depth(file: Path, unit_m: float = 1e-3) -> np.ndarray:
    """Read a depth map (h, w) float32 m from a PNG with counts of `unit_m`.

    Raises:
        DataError: if it is not a 16-bit PNG with one channel.
    """
    data = np.frombuffer(read_bytes(file), np.uint8)
    with quiet_opencv():
        image = decode_picture(data, cv2.IMREAD_UNCHANGED, f"depth map {file}", most=MOST_PIXELS)
    if image is None or image.dtype != np.uint16 or image.ndim != 2:
        found = "no image that can be decoded" if image is None else f"{image.dtype} {image.shape}"
        raise DataError(f"depth map {file} is {found}, expected a PNG of one channel, 16 bits")
    return image.astype(np.float32) * np.float32(unit_m)
