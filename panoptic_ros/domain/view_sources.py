"""Which 2D people of which images the people of an instant were made of."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol, TypeVar

import numpy as np

from panoptic_ros.domain.checks import Shapes
from panoptic_ros.errors import DataError

Array = np.ndarray


class OfFrame(Protocol):
    """What belongs to one image of a camera."""

    @property
    def frame_number(self) -> int:
        """That of the image."""


Record = TypeVar("Record", bound=OfFrame)


@dataclass(frozen=True, slots=True, eq=False)
class ViewSources:
    """The V views of an instant, and the 2D person that P people have in each.

    A camera and a frame number name one `ViewDetections`, also after a correction of its stamp.

    Args:
        cameras: (V,) names, each once. frames: (V,) `ViewDetections.frame_number`.
        persons: (P, V) index into the people of that `ViewDetections`, -1 = none. It is the one that
            gave most joints where a person was put together from several 2D people of one view, and two
            people may share one that a detector has melted together.
    """

    cameras: tuple[str, ...]
    frames: Array
    persons: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "cameras", tuple(str(name) for name in self.cameras))
        shapes = Shapes(self)
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
        """What waits, by camera, of these views, also by camera; it and older ones are taken out."""
        found: dict[str, Record] = {}
        for camera, frame in zip(self.cameras, self.frames.tolist()):
            own = waiting.get(camera, deque())
            while own and own[0].frame_number <= frame:
                oldest = own.popleft()
                if oldest.frame_number == frame:
                    found[camera] = oldest
        return found

    def rows(self, which: Array | list[int]) -> ViewSources:
        """Some of the people, by index; -1 = somebody whom no view shows."""
        nobody = np.full((1, len(self.cameras)), -1, np.int32)
        persons = np.concatenate([self.persons, nobody])
        return ViewSources(self.cameras, self.frames, persons[np.asarray(which, np.int64)])
