"""Overlay video and stills of a recorded run, with all views tiled in one picture."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np

from panoptic_ros.capture.source import FrameSource
from panoptic_ros.domain import DetectionSet, Rig, SkeletonModel, TrackedPoseSet, ViewFrame
from panoptic_ros.errors import DataError, UsageError
from panoptic_ros.view.body_drawing import ShapedBodies
from panoptic_ros.view.overlay import draw_text, draw_view
from panoptic_ros.view.pictures import Stills
from panoptic_ros.view.video_file import VideoFile

GAP = 4  # px between tiles
GROUND = 24  # grey level of areas that no image covers
Array = np.ndarray
LARGEST = (1920, 1080)  # px; largest (width, height) of a picture
VIDEO_RATE_LIMIT = 60.0  # Hz; video players have trouble with higher rates


class Mosaic:
    """Grid of equal tiles, as large as fits, with the same layout for every instant.

    Args:
        sizes: Image size (width, height) px of each view by name, in the order of tiles.
        max_size: Largest (width, height) px of the picture.

    Attributes:
        size: Picture size (width, height) px, even because video encoders require it.
        scales: Display scale of each view by name, relative to its images.

    Raises:
        UsageError: Without views, or if a tile would be smaller than one pixel.
    """

    def __init__(self, sizes: Mapping[str, tuple[int, int]], max_size: tuple[int, int] = (1920, 1080)):
        if not sizes:
            raise UsageError("a mosaic of no views")
        self.names = tuple(sizes)
        width = max(size[0] for size in sizes.values())
        height = max(size[1] for size in sizes.values())
        self.columns, scale = _best_grid(len(sizes), width, height, max_size)
        self.rows = -(-len(sizes) // self.columns)
        self._tile = (max(1, int(width * scale)), max(1, int(height * scale)))
        self.scales = {
            name: min(self._tile[0] / size[0], self._tile[1] / size[1]) for name, size in sizes.items()
        }
        across = self.columns * (self._tile[0] + GAP) - GAP
        down = self.rows * (self._tile[1] + GAP) - GAP
        self.size = (across + across % 2, down + down % 2)

    def compose(self, images: Mapping[str, Array], caption: str = "") -> Array:
        """Return the picture (H, W, 3) uint8 of all views. The tile of a view without an image says so.

        Args:
            images: Images (h, w, 3) by view name, of any size, e.g. already scaled by `scales`.
            caption: Text in the lower left corner.

        Raises:
            DataError: For an image of a view that the mosaic does not have.
        """
        unknown = sorted(set(images) - set(self.names))
        if unknown:
            raise DataError(f"the mosaic has no view {', '.join(unknown)}; it has {', '.join(self.names)}")
        canvas = np.full((self.size[1], self.size[0], 3), GROUND, np.uint8)
        size = max(0.35, min(self._tile) / 700.0)
        for i, name in enumerate(self.names):
            left = i % self.columns * (self._tile[0] + GAP)
            top = i // self.columns * (self._tile[1] + GAP)
            tile = canvas[top : top + self._tile[1], left : left + self._tile[0]]
            self._fill(tile, images.get(name))
            text = name if name in images else f"{name}: no image"
            draw_text(tile, text, (8, round(8 + 30 * size)), size, (255, 255, 255))
        if caption:
            draw_text(canvas, caption, (8, self.size[1] - 10), size, (255, 255, 255))
        return canvas

    def _fill(self, tile: Array, image: Array | None) -> None:
        if image is None:
            return
        scale = min(tile.shape[1] / image.shape[1], tile.shape[0] / image.shape[0])
        if abs(scale - 1.0) > 1.0 / max(tile.shape):
            size = (max(1, int(image.shape[1] * scale)), max(1, int(image.shape[0] * scale)))
            image = cv2.resize(image, size, interpolation=cv2.INTER_AREA if scale < 1.0 else cv2.INTER_LINEAR)
        height, width = min(image.shape[0], tile.shape[0]), min(image.shape[1], tile.shape[1])
        top, left = (tile.shape[0] - height) // 2, (tile.shape[1] - width) // 2
        tile[top : top + height, left : left + width] = image[:height, :width]


def _best_grid(count: int, width: int, height: int, limit: tuple[int, int]) -> tuple[int, float]:
    """Return the number of columns and the scale (at most 1) for the largest tiles of (width, height) px.

    Among grids with an equal scale, the one with the aspect ratio closest to that of `limit` wins.
    """
    best, best_shape = (1, 0.0), math.inf
    for columns in range(1, count + 1):
        rows = -(-count // columns)
        room_x, room_y = limit[0] - (columns - 1) * GAP, limit[1] - (rows - 1) * GAP
        # reserve one pixel, since an odd picture size is rounded up to an even one
        scale = min(1.0, (room_x - 1) / (columns * width), (room_y - 1) / (rows * height))
        shape = abs(math.log(columns * width * limit[1] / (rows * height * limit[0])))
        if scale > best[1] or (scale == best[1] and shape < best_shape):
            best, best_shape = (columns, scale), shape
    if best[1] * min(width, height) < 1.0:
        raise UsageError(f"{count} views do not fit a picture of {limit[0]}x{limit[1]}")
    return best


class OverlayRun:
    """Writer of the overlay video and stills of a recorded run.

    Each picture shows all views side by side with the skeletons of one instant.
    """

    def __init__(self, rig: Rig, skeleton: SkeletonModel, bodies: ShapedBodies | None = None):
        """Store the models of the run.

        Args:
            rig: Calibrated cameras.
            skeleton: Skeleton of detections and poses.
            bodies: Bodies of all instants, sorted by time. Each image shows those nearest in time.
        """
        self._rig, self._skeleton, self._bodies = rig, skeleton, bodies

    def write(
        self,
        folder: Path,
        sources: Sequence[FrameSource],
        detections: Sequence[DetectionSet],
        poses: Sequence[TrackedPoseSet],
        *,
        stills: int = 4,
        on_frame: Callable[[int], None] | None = None,
    ) -> list[Path]:
        """Write overlay.mp4 and some stills.

        This reads the recorded sources a second time. Every view of a detection set names its frame. Poses
        belong to the detection set of the same index, although their timestamp can be a little later. Only
        one picture is in memory at a time.

        Args:
            folder: Output folder, created if missing.
            sources: Recorded sources of any of the rig's cameras.
            detections: Detection sets sorted by time. Each yields one picture.
            poses: Tracked poses, matched to `detections` by index.
            stills: Number of stills in addition to the video, evenly spread over it.
            on_frame: Callback with the number of finished pictures, for a progress bar.

        Returns:
            The files written; none without detections or sources.

        Raises:
            DataError: If a source and the rig do not fit, or a source cannot be read.
            EnvironmentProblem: If files cannot be written.
        """
        if not detections or not sources:
            return []
        mosaic = Mosaic({source.camera: source.image_size for source in sources}, LARGEST)
        by_index = {pose.index: pose for pose in poses}
        first, last = detections[0].stamp_ns, detections[-1].stamp_ns
        instants = tuple((last - first) * (i + 0.5) / stills / 1e9 for i in range(stills))
        gallery = Stills(Path(folder), instants, ".jpg")
        with ExitStack() as stack:
            readers = {source.camera: _Reader(source) for source in sources}
            for reader in readers.values():
                stack.callback(reader.close)
            path = Path(folder) / "overlay.mp4"
            video = stack.enter_context(VideoFile(path, mosaic.size, _rate(detections)))
            for done, found in enumerate(detections, start=1):
                images = self._views(found, by_index.get(found.index), readers, mosaic.scales)
                picture = mosaic.compose(images, f"{(found.stamp_ns - first) / 1e9:.2f} s")
                video.write(picture)
                gallery.offer(found.stamp_ns, picture)
                if on_frame is not None:
                    on_frame(done)
            gallery.close()
        return [video.path, *gallery.written]

    def _views(
        self,
        found: DetectionSet,
        poses: TrackedPoseSet | None,
        readers: Mapping[str, _Reader],
        scales: Mapping[str, float],
    ) -> dict[str, Array]:
        """Return the drawn image of each camera that has one."""
        images = {}
        for view in found.views:
            frame = readers[view.camera].frame(view.frame_number) if view.camera in readers else None
            if frame is not None:
                images[view.camera] = draw_view(
                    frame.image,
                    self._rig.camera(view.camera),
                    poses,
                    self._skeleton,
                    view,
                    scale=scales[view.camera],
                    bodies=None if self._bodies is None else self._bodies.near(view.stamp_ns),
                )
        return images


class _Reader:
    """Forward-only reader of one source's frames by frame number."""

    def __init__(self, source: FrameSource):
        self._source = source
        self._frames: Iterator[ViewFrame] | None = iter(source)
        self._now: ViewFrame | None = None

    def frame(self, number: int) -> ViewFrame | None:
        """Return the frame of that number, or None if the source does not have it."""
        while self._frames is not None and (self._now is None or self._now.frame_number < number):
            self._now = next(self._frames, None)
            if self._now is None:
                self._frames = None
        return self._now if self._now is not None and self._now.frame_number == number else None

    def close(self) -> None:
        self._source.close()


def _rate(detections: Sequence[DetectionSet]) -> float:
    """Return the frame rate (Hz) for real-time playback: 1 / (median time step), clipped to 1..60 Hz."""
    if len(detections) < 2:
        return 30.0
    steps = np.diff([found.stamp_ns for found in detections])
    rate = Fraction(1_000_000_000 / float(np.median(steps))).limit_denominator(1001)
    return min(max(float(rate), 1.0), VIDEO_RATE_LIMIT)
