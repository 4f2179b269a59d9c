"""Resample the bodies of one person to a fixed rate, as most motion formats require."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from panoptic_ros.domain.body_shape import offsets_of
from panoptic_ros.domain.segments import SegmentModel
from panoptic_ros.domain.subjects import BodyState
from panoptic_ros.errors import DataError

Array = np.ndarray


class ResampledMotion(NamedTuple):
    """Motion of one person at a fixed rate: N frames of S segments.

    Args:
        period: frame period, s.
        places: (N, S, 3) m, joint positions in the world.
        frames: (N, S, 3, 3), rotation world from segment.
        offsets: (S, 3) m, joints in the frames of their parents.
        first_ns: timestamp of the first frame, ns.
    """

    period: float
    places: Array
    frames: Array
    offsets: Array
    first_ns: int


def motion_of(model: SegmentModel, states: Sequence[BodyState], what: str) -> ResampledMotion:
    """Return the motion of one person; a missing body is replaced by the previous one.

    Args:
        states: bodies of one person in order of time.
        what: name of the format, for the error message.

    Raises:
        DataError: if there are fewer than two frames.
    """
    if len(states) < 2:
        raise DataError(f"{what} needs two instants of a body at least; there are {len(states)}")
    stamps = np.array([state.stamp_ns for state in states])
    period = float(np.median(np.diff(stamps)))
    count = round((stamps[-1] - stamps[0]) / period) + 1
    instants = stamps[0] + period * (np.arange(count) + 0.5)
    rows = np.searchsorted(stamps, instants, side="right") - 1
    places, frames = (np.array([getattr(s, name) for s in states])[rows] for name in ("places", "frames"))
    return ResampledMotion(1e-9 * period, places, frames, offsets_of(model, places, frames), int(stamps[0]))


def local_turns(model: SegmentModel, frames: Array) -> Array:
    """Return segment rotations (N, S, 3, 3) relative to their parents; of the root relative to the world."""
    turns: Array = frames[:, model.parents].swapaxes(-1, -2) @ frames
    turns[:, 0] = frames[:, 0]
    return turns
