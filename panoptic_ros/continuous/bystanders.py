"""Bystanders: people who never stand where enough cameras look, see `solving.capture_space`.

Rays of two bystanders may meet by chance. Such a false person has no human size.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from panoptic_ros.continuous.seen_views import SeenViews
from panoptic_ros.domain import Camera
from panoptic_ros.solving.capture_space import in_capture_space

Array = np.ndarray
PART = 100  # number of instants that are tested at once
# m, limits of the size of a person: for adults of 1.5 to 1.9 m it is 0.46 to 0.57 m. That of false people in
# ten captures with bystanders is 0.14 m, or 3 m and more
LEAST_SIZE, MOST_SIZE = 0.18, 1.0
SIZE_SHARE = 0.9  # quantile of distances within rigid parts that is the size: a wild joint is in few


def has_human_size(lengths: Array) -> bool:
    """Return whether distances (P,) m within rigid parts are those of a person; 0 or NaN = unknown."""
    known = np.sort(lengths[lengths > 0.0])
    if not len(known):
        return True
    size = np.interp(SIZE_SHARE * (len(known) - 1), np.arange(len(known)), known)
    return bool(LEAST_SIZE <= size <= MOST_SIZE)


def are_inside(
    instants: Array,
    positions: Array,
    times: Array,
    of_cameras: Array,
    period: float,
    cameras: Sequence[Camera],
    needed: int,
) -> Array:
    """Return whether a person is in the capture space at instants (T,) s.

    Args:
        positions: (T, J, 3) m, NaN = missing.
        times, of_cameras: (V,) s, sorted, and indices of the cameras of the views that show the person.
        period: (s) time within which a camera exposes.
        needed: see `needed_views`.
    """
    first, last = (
        np.searchsorted(times, instants - period),
        np.searchsorted(times, instants + period, "right"),
    )
    supporting = np.array([len(np.unique(of_cameras[a:b])) for a, b in zip(first, last)])
    return in_capture_space(positions, supporting, cameras, needed)


def first_inside(
    seen: SeenViews,
    positions_at: Callable[[Array], Array],
    period: float,
    cameras: Sequence[Camera],
    needed: int,
) -> float | None:
    """Return the time (s) of the first view of a person in the capture space; None = never there.

    Args:
        positions_at: returns the positions (T, J, 3) m of the person at times (T,) s.
        period, cameras, needed: see `are_inside`.
    """
    for begin in range(0, len(seen.times), PART):
        times = seen.times[begin : begin + PART]
        inside = are_inside(times, positions_at(times), seen.times, seen.cameras, period, cameras, needed)
        if inside.any():
            return float(times[np.argmax(inside)])
    return None
