"""A source whose stamps are corrected by what is known of its camera's clock, or that ends early."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

from panoptic_ros.capture.image_folder import ImageFolderSource
from panoptic_ros.capture.timed import TimedSource
from panoptic_ros.capture.video import VideoSource
from panoptic_ros.domain import StampLine, ViewFrame
from panoptic_ros.errors import DataError
from panoptic_ros.stage import Notice


class CorrectedSource:
    """The frames of a source with other stamps; those that would lie before 0 are left out.

    Args:
        line: a `StampLine` in plain words; None = the stamps are right.
        until_ns: frames with this stamp and later ones are left out.

    Raises:
        DataError: if the line has no such numbers.
    """

    def __init__(
        self,
        source: VideoSource | ImageFolderSource | TimedSource,
        line: Mapping[str, Any] | None,
        until_ns: int | None = None,
    ):
        try:
            self._line = None if line is None else StampLine.from_words(line)
        except DataError as error:
            raise DataError(f"camera {source.camera}: {error}") from None
        self._source, self._until_ns = source, until_ns
        self.camera, self.path, self.image_size = source.camera, source.path, source.image_size
        self.frame_rate, self.frame_count = source.frame_rate, source.frame_count

    def __iter__(self) -> Iterator[ViewFrame]:
        for frame in self._source:
            stamp = frame.stamp_ns if self._line is None else self._line.corrected(frame.stamp_ns)
            if self._until_ns is not None and stamp >= self._until_ns:
                return
            if stamp >= 0:
                yield frame if stamp == frame.stamp_ns else replace(frame, stamp_ns=stamp)

    @property
    def after(self) -> tuple[Notice, ...]:
        """Return notices that are known after the last frame."""
        return self._source.after

    def close(self) -> None:
        """Close the source."""
        self._source.close()

    def __enter__(self) -> CorrectedSource:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()
