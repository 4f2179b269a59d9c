"""First appearance of a person, from which the person gets a number, as in tracking."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from panoptic_ros.continuous.bystanders import are_inside
from panoptic_ros.continuous.seen_views import SeenViews
from panoptic_ros.domain import Camera
from panoptic_ros.identity.numbering import numbering_places

Array = np.ndarray
JOINT_VIEWS, JOINT_SHARE = 2, 0.6  # cameras per joint and share of the joints, as `tracking.confirm_joints`
EVERY = 10  # views of a person from one test of its place to the next, where no instant has enough joints
# periods of a camera within which people appear together: the next set of synchronous cameras is left out
TOGETHER = 0.9
PART = 100  # number of instants that are tested at once


class FirstAppearance(NamedTuple):
    """First time at which a person in the capture space is shown well.

    Args:
        time: (s).
        place: (2,) m, world, see `identity.numbering.numbering_places`.
    """

    time: float
    place: Array


def well_shown(seen: SeenViews, period: float) -> Array:
    """Return a mask (V,) of views about which enough joints are seen by enough cameras.

    Views are counted within half a period (s).
    """
    first = np.searchsorted(seen.times, seen.times - 0.5 * period)
    last = np.searchsorted(seen.times, seen.times + 0.5 * period, "right")
    joints = np.zeros(seen.scores.shape, np.int64)  # number of cameras
    people = np.zeros((len(seen.times), 1), np.int64)
    for camera in np.unique(seen.cameras):
        own = (seen.cameras == camera)[:, None]
        for counts, known in ((joints, own & (seen.scores > 0.0)), (people, own)):
            sums = np.concatenate([np.zeros((1, known.shape[1]), np.int64), known.cumsum(axis=0)])
            counts += sums[last] > sums[first]
    enough = np.where(people == JOINT_VIEWS, 1, JOINT_VIEWS)  # bones complete joints of people of two views
    shown: Array = ((joints >= enough).mean(axis=1) >= JOINT_SHARE) & (people[:, 0] >= JOINT_VIEWS)
    return shown


def appearance(
    seen: SeenViews,
    positions_at: Callable[[Array], Array],
    period: float,
    cameras: Sequence[Camera],
    needed: int,
) -> FirstAppearance | None:
    """Return the appearance of a person; None if the person is never in the capture space.

    Args:
        positions_at: returns the positions (T, J, 3) m of the person at times (T,) s.
        period: (s) time within which a camera exposes.
        needed: see `solving.capture_space.needed_views`.
    """
    for rows in (np.flatnonzero(well_shown(seen, period)), np.arange(0, len(seen.times), EVERY)):
        for begin in range(0, len(rows), PART):
            times = seen.times[rows[begin : begin + PART]]
            positions = positions_at(times)
            inside = are_inside(times, positions, seen.times, seen.cameras, period, cameras, needed)
            if inside.any():
                k = int(np.argmax(inside))
                return FirstAppearance(float(times[k]), numbering_places(positions[k : k + 1])[0])
    return None
