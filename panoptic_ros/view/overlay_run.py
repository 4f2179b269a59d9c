"""Overlay video and stills of a whole recorded run."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from fractions import Fraction
from pathlib import Path

import numpy as np

from panoptic_ros.capture.source import FrameSource
from panoptic_ros.domain import DetectionSet, Rig, SkeletonModel, TrackedPoseSet, ViewFrame
from panoptic_ros.view.body_drawing import ShapedBodies
from panoptic_ros.view.mosaic import Mosaic
from panoptic_ros.view.overlay import draw_view
from panoptic_ros.view.pictures import Stills
from panoptic_ros.view.video_file import VideoFile

Array = np.ndarray
LARGEST = (1920, 1080)  # px, of a picture
VIDEO_RATE_LIMIT = 60.0  # Hz; players have trouble beyond


class OverlayRun:
    """Overlay video and stills of a recorded run: all views side by side, with each instant's skeletons."""

    def __init__(self, rig: Rig, skeleton: SkeletonModel, bodies: ShapedBodies | None = None):
        """bodies: by time, of all instants; the nearest to each image is drawn."""
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

        The recorded sources are read a second time; every view of a detection set names its frame, and
        poses belong to the detection set of the same index (their stamp can lie a little later). One picture
        is in memory at a time.

        Args:
            folder: made if it is not there.
            sources: recorded ones, of any of the rig's cameras.
            detections: in the order of time; one picture each.
            stills: how many pictures besides the video, evenly spread over it.
            on_frame: called with the number of pictures done, for a progress bar.

        Returns:
            the files written; none without detections.

        Raises:
            DataError: if a source and the rig do not fit, or a source cannot be read.
            EnvironmentProblem: if files cannot be written.
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
        """The drawn image of each camera that has one."""
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
    """Frames of one source by their number, forwards only."""

    def __init__(self, source: FrameSource):
        self._source = source
        self._frames: Iterator[ViewFrame] | None = iter(source)
        self._now: ViewFrame | None = None

    def frame(self, number: int) -> ViewFrame | None:
        """The frame of that number, None if the source does not have it."""
        while self._frames is not None and (self._now is None or self._now.frame_number < number):
            self._now = next(self._frames, None)
            if self._now is None:
                self._frames = None
        return self._now if self._now is not None and self._now.frame_number == number else None

    def close(self) -> None:
        self._source.close()


def _rate(detections: Sequence[DetectionSet]) -> float:
    """Pictures per second so that the video runs as fast as the people did, Hz."""
    if len(detections) < 2:
        return 30.0
    steps = np.diff([found.stamp_ns for found in detections])
    rate = Fraction(1_000_000_000 / float(np.median(steps))).limit_denominator(1001)
    return min(max(float(rate), 1.0), VIDEO_RATE_LIMIT)
