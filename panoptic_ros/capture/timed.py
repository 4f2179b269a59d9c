"""A source whose frames are stamped by a table: frames without a time are left out."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

from panoptic_ros.capture.image_folder import ImageFolderSource
from panoptic_ros.capture.source import check_stamps
from panoptic_ros.capture.video import VideoSource
from panoptic_ros.domain import ViewFrame
from panoptic_ros.errors import DataError
from panoptic_ros.stage import Notice


class TimedSource:
    """The frames of a file that a table has times for.

    Devices may count frames from before the recording, as caliscope's cameras do, and do not count anew. A
    table with one row for each frame of the file, but with numbers beyond its last frame, has such numbers:
    the rows are the frames in their order then, and `notices` states it.

    Args:
        times: stamp in ns by number of the frame.

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
        """Return notices that are known after the last frame."""
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
