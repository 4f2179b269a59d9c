"""2D poses that the people of an instant were made from, by image."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol, TypeVar

import numpy as np

from panoptic_ros.domain.checks import ShapeChecks
from panoptic_ros.errors import DataError

Array = np.ndarray


class FrameRecord(Protocol):
    """Record that belongs to one image of a camera."""

    @property
    def frame_number(self) -> int:
        """Return the frame number of the image."""


Record = TypeVar("Record", bound=FrameRecord)


@dataclass(frozen=True, slots=True, eq=False)
class ViewSources:
    """The V views of an instant, and the 2D pose of each of P people in each view.

    A camera and a frame number identify one `ViewDetections`, also after a correction of its timestamp.

    Args:
        cameras: (V,) names, each once.
        frames: (V,) `ViewDetections.frame_number`.
        persons: (P, V) index into the people of that `ViewDetections`, -1 = none. A person may be made from
            several 2D poses of one view: the index is that of the pose with most joints. Two people may share
            one pose that a detector has merged.
    """

    cameras: tuple[str, ...]
    frames: Array
    persons: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "cameras", tuple(str(name) for name in self.cameras))
        shapes = ShapeChecks(self)
        frames = shapes.store("frames", np.int64, "V")
        persons = shapes.store("persons", np.int32, "P V")
        if len(frames) != len(self.cameras):
            raise DataError(f"{len(frames)} frame numbers for the views of {len(self.cameras)} cameras")
        if len(set(self.cameras)) != len(self.cameras):
            raise DataError(f"views of one instant have a camera twice: {', '.join(self.cameras)}")
        if frames.size and frames.min() < 0:
            raise DataError(f"ViewSources.frames has the frame number {frames.min()}; they count from 0")
        if persons.size and persons.min() < -1:
            raise DataError(f"ViewSources.persons has the index {persons.min()}; -1 = no 2D person")

    def taken_from(self, waiting: Mapping[str, deque[Record]]) -> dict[str, Record]:
        """Remove the records of these views from the queues `waiting`, and return them by camera.

        Older records are discarded.
        """
        found: dict[str, Record] = {}
        for camera, frame in zip(self.cameras, self.frames.tolist()):
            own = waiting.get(camera, deque())
            while own and own[0].frame_number <= frame:
                oldest = own.popleft()
                if oldest.frame_number == frame:
                    found[camera] = oldest
        return found

    def rows(self, which: Array | list[int]) -> ViewSources:
        """Return the people with these indices; index -1 gives a person without any 2D pose."""
        nobody = np.full((1, len(self.cameras)), -1, np.int32)
        persons = np.concatenate([self.persons, nobody])
        return ViewSources(self.cameras, self.frames, persons[np.asarray(which, np.int64)])
