"""Images of a recording without calibration: a folder of videos or images, or a bag."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from panoptic_ros.capture.folder import folder_stamps, open_files
from panoptic_ros.capture.image_folder import ImageFolderSource, image_files
from panoptic_ros.capture.layout import cameras_of
from panoptic_ros.capture.source import FrameSource
from panoptic_ros.capture.video import VideoSource
from panoptic_ros.domain import Camera, Rig, ViewFrame
from panoptic_ros.errors import CalibrationError, DataError
from panoptic_ros.geometry import Intrinsics, Rigid
from panoptic_ros.io.bag_streams import BagStream
from panoptic_ros.io.bags import BagReader, is_bag
from panoptic_ros.running.plans.bag_topics import camera_image_streams, with_encodings


@dataclass(frozen=True, eq=False)
class RecordedImages:
    """Images of all cameras of a recording.

    Args:
        sources: One per camera.
        notices: Lines about the recording; filled while images are read, too.
    """

    sources: Sequence[FrameSource]
    notices: list[str]


@contextmanager
def open_images(path: Path) -> Iterator[RecordedImages]:
    """Open a folder with one video or folder of images per camera, or a bag with image topics.

    Raises:
        DataError: if it has no images.
    """
    with ExitStack() as stack:
        if is_bag(path):
            bag = stack.enter_context(BagReader(path))
            streams, lines = with_encodings(camera_image_streams(bag), [bag])
            notices = list(lines)
            yield RecordedImages([BagImages(stream, bag, notices) for stream in streams], notices)
            return
        files = cameras_of(path)
        rig = _unknown_rig(files)
        stamps, times = folder_stamps(path, files, rig.names)
        capture = stack.enter_context(open_files(rig, files, stamps=stamps, times=times))
        yield RecordedImages(capture.sources, list(capture.notices))


def image_names(source: FrameSource) -> list[str]:
    """Return the names of the files of a source by frame number; empty for videos and bags."""
    path = getattr(source, "path", None)  # messages of bags have none
    return [] if path is None else [file.name for file in image_files(path)]


class BagImages:
    """Images of one topic of a bag, as a `FrameSource`.

    Args:
        notices: Receives a line about messages without a usable image, after each iteration.
    """

    def __init__(self, stream: BagStream, bag: BagReader, notices: list[str]):
        self.camera = stream.camera
        self._stream, self._bag, self._notices = stream, bag, notices
        height, width = stream.first_record(bag).image.shape[:2]
        self.image_size = (int(width), int(height))
        stamps = stream.first_stamps(bag)
        self.frame_rate = 1e9 / max(float(np.median(np.diff(stamps))), 1.0) if len(stamps) > 1 else 0.0
        self.frame_count: int | None = bag.counts[stream.topic]

    def __iter__(self) -> Iterator[ViewFrame]:
        bad = 0
        for number, item in enumerate(self._stream.messages(self._bag)):
            try:
                if isinstance(item, DataError):
                    raise item
                frame: ViewFrame = self._stream.record(item.message, number)
            except DataError:
                bad += 1
                continue
            size = frame.image.shape[1::-1]
            if tuple(size) != self.image_size:
                raise CalibrationError(
                    f"camera {self.camera}: image {number} has {size[0]} x {size[1]} px, the first has "
                    f"{self.image_size[0]} x {self.image_size[1]}; record one size"
                )
            yield frame
        if bad:
            self._notices.append(f"camera {self.camera}: {bad} messages without a usable image were left out")

    def close(self) -> None:
        """See `FrameSource`."""

    def __enter__(self) -> BagImages:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


def _unknown_rig(files: Mapping[str, Path]) -> Rig:
    """Return a rig with the names and image sizes of the files; its lenses and poses mean nothing."""
    cameras = []
    for name, path in files.items():
        open_source = ImageFolderSource if path.is_dir() else VideoSource
        with open_source(name, path) as source:
            size = source.image_size
        focal = float(max(size))
        matrix = np.array([[focal, 0.0, 0.5 * size[0]], [0.0, focal, 0.5 * size[1]], [0.0, 0.0, 1.0]])
        cameras.append(Camera(name, size, Intrinsics(matrix, np.zeros(5)), Rigid.identity()))
    return Rig(tuple(cameras))
