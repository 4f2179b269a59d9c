"""Sources with timestamps from a table, and sources with timestamps corrected by a clock model.

Frames without a time in the table are skipped. A corrected source may also end early.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

from panoptic_ros.capture.image_folder import ImageFolderSource
from panoptic_ros.capture.source import check_stamps
from panoptic_ros.capture.video import VideoSource
from panoptic_ros.domain import StampLine, ViewFrame
from panoptic_ros.errors import DataError
from panoptic_ros.stage import Notice


class TimedSource:
    """Frames of a video file or image folder whose timestamps are in a table.

    Some devices, such as caliscope's cameras, start to count frames before the recording starts and do not
    reset the counter. The table then has one row for each frame of the file, but its frame numbers exceed
    those of the file. In this case the rows are assigned to the frames in order, and `notices` reports it.

    Args:
        times: timestamp (ns) by frame number.

    Raises:
        DataError: if none of the frames has a time, or times do not increase.
    """

    def __init__(self, source: VideoSource | ImageFolderSource, times: Mapping[int, int]):
        self._source = source
        what = f"sync table of camera {source.camera}"
        count = source.frame_count
        self.notices: tuple[str, ...] = ()
        if len(times) == count and max(times) >= count:
            self.notices = (_recounted(times, count),)
            times = dict(enumerate(times[number] for number in sorted(times)))
        numbers = [number for number in sorted(times) if count is None or number < count]
        self.stamps = dict(zip(numbers, check_stamps([times[number] for number in numbers], what)))
        if not numbers:
            raise DataError(f"{what} has no time for any of the {count} frames of {source.path}")
        self.camera, self.path, self.image_size = source.camera, source.path, source.image_size
        self.frame_rate = source.frame_rate
        self.frame_count: int | None = None if count is None else len(numbers)

    def __iter__(self) -> Iterator[ViewFrame]:
        for frame in self._source:
            stamp = self.stamps.get(frame.frame_number)
            if stamp is not None:
                yield replace(frame, stamp_ns=stamp)

    @property
    def after(self) -> tuple[Notice, ...]:
        """Return the notices that are available after the last frame."""
        return self._source.after

    def close(self) -> None:
        """Close the images."""
        self._source.close()

    def __enter__(self) -> TimedSource:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


def _recounted(times: Mapping[int, int], count: int) -> str:
    return (
        f"numbers {min(times)} to {max(times)} of the table of stamps are not those of the {count} frames of "
        "the file; rows are taken as frames in their order"
    )


class CorrectedSource:
    """Frames of a source with corrected timestamps; frames with a timestamp below 0 are skipped.

    Args:
        line: a `StampLine` as a plain dictionary; None = no correction.
        until_ns: frames with this timestamp and later ones are skipped.

    Raises:
        DataError: if `line` is invalid.
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
        """Return the notices that are available after the last frame."""
        return self._source.after

    def close(self) -> None:
        """Close the source."""
        self._source.close()

    def __enter__(self) -> CorrectedSource:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()
