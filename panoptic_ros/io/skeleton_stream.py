"""skeletons.json.gz frame by frame: a run of hours needs no more memory than one of minutes."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from panoptic_ros.domain import TrackedPoseSet
from panoptic_ros.io.frame_stream import FrameStream
from panoptic_ros.io.plain_formats import SKELETONS, skeletons_frame


class SkeletonStream:
    """The bytes are those of `io.plain_formats.write_skeletons`, gzipped whatever the name.

    Raises:
        EnvironmentProblem: if the file cannot be written.
    """

    def __init__(self, path: Path, joint_names: Iterable[str]):
        self._frames = FrameStream(path, {"format": SKELETONS, "joint_names": list(joint_names)})

    @property
    def count(self) -> int:
        """Frames so far."""
        return self._frames.count

    def add(self, item: TrackedPoseSet) -> None:
        """One more frame."""
        self._frames.add(skeletons_frame(item))

    def sync(self) -> None:
        """See `FrameStream`."""
        self._frames.sync()

    def close(self) -> None:
        """Finish the file."""
        self._frames.close()

    def discard(self) -> None:
        """Give the file up."""
        self._frames.discard()
