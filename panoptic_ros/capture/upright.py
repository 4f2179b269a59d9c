"""Convert decoded frames to upright images: deinterlace to the first field and apply the display matrix.

Images are identical to OpenCV's for the same file: FFmpeg's bicubic conversion to BGR.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, cast

import av
import cv2
import numpy as np
from av.filter import Graph
from av.video.frame import VideoFrame
from av.video.reformatter import Interpolation, VideoReformatter

from panoptic_ros.capture.packets import reason
from panoptic_ros.errors import DataError

Array = np.ndarray
# FFmpeg's own deinterlacer, one image per frame: rows of the first field stay unchanged
DEINTERLACER = ("bwdif", "mode=send_frame:deint=interlaced")
QUARTER = 0.02  # rad, tolerance of a quarter turn in the display matrix


@dataclass(frozen=True)
class Orientation:
    """Display orientation of a file's images: mirrored left to right, then rotated clockwise.

    Args:
        degrees: 0, 90, 180, 270; any other angle is ignored.
        mirrored: images are mirrored.
    """

    degrees: int = 0
    mirrored: bool = False

    @property
    def is_obeyed(self) -> bool:
        """Return whether the orientation can be applied without resampling."""
        return self.degrees % 90 == 0

    def __str__(self) -> str:
        if not self.is_obeyed:
            return f"images are marked as turned by {self.degrees} degrees, no quarter turn: left as stored"
        turn = f"turned clockwise by {self.degrees} degrees" if self.degrees else ""
        mirror = "mirrored left to right" if self.mirrored else ""
        if self.mirrored and self.degrees == 180:
            turn, mirror = "", "mirrored top to bottom"
        return f"images are {' and '.join(filter(None, (mirror, turn)))}, as marked in the file"

    def applied(self, image: Array) -> Array:
        """Return the image (H, W, 3) rotated and mirrored."""
        if not self.is_obeyed:
            return image
        shown = cv2.flip(image, 1) if self.mirrored else image
        turns = {90: cv2.ROTATE_90_CLOCKWISE, 180: cv2.ROTATE_180, 270: cv2.ROTATE_90_COUNTERCLOCKWISE}
        return cv2.rotate(shown, turns[self.degrees]) if self.degrees else shown


UPRIGHT = Orientation()


def orientation_of(frame: VideoFrame) -> Orientation:
    """Read the display matrix of a frame (ISO/IEC 14496-12, 8.3.2) without its scale."""
    try:
        matrix: Any = cast(Any, frame.side_data)["DISPLAYMATRIX"]  # PyAV declares another type for it
    except KeyError:
        return UPRIGHT
    except ValueError:  # other side data that PyAV cannot name
        return Orientation(-int(frame.rotation) % 360)
    # a point is a row vector (x, y) with y down: (x', y') = (a x + c y, b x + d y)
    a, b, _, c, d = (float(entry) for entry in np.frombuffer(bytes(matrix), np.int32)[:5])
    mirrored = a * d - b * c < 0
    across, along = (-a, -b) if mirrored else (a, b)  # direction of the image's x axis after mirroring
    degrees = math.degrees(math.atan2(along, across)) % 360
    quarter = round(degrees / 90) * 90
    near = abs(math.radians(degrees - quarter)) <= QUARTER
    return Orientation(quarter % 360 if near else round(degrees), mirrored)


class Converter:
    """Converter of decoded frames to upright images."""

    def __init__(self) -> None:
        self._reformatter = VideoReformatter()
        self._orientation: Orientation | None = None

    def image(self, frame: VideoFrame) -> Array:
        """Return (H, W, 3) uint8 BGR in the display orientation of the first frame.

        Raises:
            DataError: if FFmpeg cannot convert the frame's format, as in a damaged file.
        """
        try:
            bgr = self._reformatter.reformat(
                frame, format="bgr24", interpolation=Interpolation.BICUBIC, threads=1
            )  # one thread: every camera has its own
            pixels = bgr.to_ndarray()
        except (av.FFmpegError, OSError, ValueError) as error:
            kind = getattr(frame.format, "name", "unknown")
            raise DataError(
                f"a video frame of {frame.width}x{frame.height}, format {kind}, cannot be converted to an "
                f"image ({reason(error)}); the file is damaged"
            ) from None
        if self._orientation is None:
            self._orientation = orientation_of(frame)
        return np.ascontiguousarray(self._orientation.applied(pixels))


def whole_images(frames: Iterator[VideoFrame]) -> Iterator[VideoFrame]:
    """Yield the same frames at the same times; interlaced frames keep only the rows of their first field.

    Raises:
        DataError: as `frames` does, after all frames before.
    """
    graph: Graph | None = None
    times: deque[tuple[int | None, int | None, Fraction | None]] = deque()
    problem = None
    while True:
        try:
            frame = next(frames, None)
        except DataError as error:
            frame, problem = None, error
        if graph is None and frame is not None and frame.interlaced_frame:
            graph = _deinterlacing(frame)
        if graph is None and frame is not None:
            yield frame
        elif graph is not None:
            if frame is not None:
                times.append((frame.pts, frame.dts, frame.time_base))
            graph.vpush(frame)
            while times and (whole := _pulled(graph)) is not None:
                whole.pts, whole.dts, whole.time_base = times.popleft()
                yield whole
        if frame is None:
            if problem is not None:
                raise problem
            return
        del frame  # release its memory for the next frame


def _deinterlacing(frame: VideoFrame) -> Graph:
    graph = Graph()
    source = graph.add_buffer(
        width=frame.width, height=frame.height, format=frame.format, time_base=frame.time_base
    )
    graph.link_nodes(source, graph.add(*DEINTERLACER), graph.add("buffersink"))
    graph.configure()
    return graph


def _pulled(graph: Graph) -> VideoFrame | None:
    """Return the next image that is ready, else None."""
    try:
        return graph.vpull()
    except (av.error.BlockingIOError, av.error.EOFError):
        return None
