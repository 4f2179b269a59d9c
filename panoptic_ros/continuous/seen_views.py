"""Views that show one person, as arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from panoptic_ros.continuous.follow import Entry
from panoptic_ros.domain.of_all import of_all
from panoptic_ros.solving.frames import CameraFrame

Array = np.ndarray


class SeenViews(NamedTuple):
    """V views of one person in the order of their times, with J joints.

    Args:
        frames: (V,) numbers of the frames.
        times: (V,) s.
        cameras: (V,) indices.
        depths: (V,) m, of the person in the camera.
        mirrored: (V,) True if left and right of the 2D person were exchanged.
        plane: (V, J, 2) undistorted normalised points.
        scores: (V, J), 0 where missing.
        heights: (V, J) px, rows of the images.
        squares: (V, J) squared innovations of the association, see `motion.update`.
    """

    frames: Array
    times: Array
    cameras: Array
    depths: Array
    mirrored: Array
    plane: Array
    scores: Array
    heights: Array
    squares: Array

    def part(self, first: int, last: int | None = None) -> SeenViews:
        """Return the views first..last, exclusive."""
        return of_all(lambda values: values[first:last], self)

    @classmethod
    def of(
        cls,
        entries: Sequence[Entry],
        frames: Mapping[int, CameraFrame] | Sequence[CameraFrame],
        times: Mapping[int, float] | Array,
        mirror: Array,
    ) -> SeenViews:
        """Return the views of a track.

        Args:
            frames, times: by the number of the frame; times in s.
            mirror: (J,) joint on the other side of each joint.
        """
        joints = len(mirror)
        views = [frames[entry.frame] for entry in entries]
        sides = np.arange(joints), mirror
        picks = [(entry.person, sides[entry.mirrored]) for entry in entries]
        none = np.zeros(joints)
        rows = (
            [view.plane[pick] for view, pick in zip(views, picks)],
            [view.scores[pick] for view, pick in zip(views, picks)],
            [view.heights[pick] for view, pick in zip(views, picks)],
            [entry.squares if len(entry.squares) else none for entry in entries],
        )
        return cls(
            np.array([entry.frame for entry in entries], np.int64),
            np.array([times[entry.frame] for entry in entries], np.float64),
            np.array([view.camera for view in views], np.int64),
            np.array([entry.depth for entry in entries], np.float64),
            np.array([entry.mirrored for entry in entries], np.bool_),
            *(np.array(values, np.float64) for values in rows),
        )
