"""Order in which new people are numbered, in tracking and in continuous time.

It depends on times and places of appearance only, not on the order of rows, cameras or tracks.
"""

from __future__ import annotations

import numpy as np

Array = np.ndarray
# Direction on the ground, x and y of the world. Noise exchanges few people: for up to 6 people 1 m apart in
# rows, grids and round tables that are aligned with the axes, the least distance along it is largest, 0.1 m.
DIRECTION = np.array([1.0, 0.44]) / np.hypot(1.0, 0.44)


def numbering_order(places: Array, times: Array | None = None, interval: float = 0.0) -> Array:
    """Return the order (P,) in which people who have appeared get their numbers.

    Earlier people come first. People who have appeared together are in order of their places.

    Args:
        places: (P, 2) m, world, places on the ground at appearance.
        times: (P,) s, of appearance; None = the same time for all.
        interval: (s) time after the first of several people in which others appear together with it.
    """
    if times is None:
        times = np.zeros(len(places))
    groups = np.zeros(len(places), np.int64)
    first, group = -np.inf, 0
    for row in np.argsort(times, kind="stable").tolist():
        if times[row] > first + interval:
            first, group = times[row], group + 1
        groups[row] = group
    order: Array = np.lexsort((places @ DIRECTION, groups))
    return order


def numbering_places(positions: Array) -> Array:
    """Return the places (P, 2) m on the ground of people with joints (P, J, 3) m, world, NaN = missing.

    They are means over the joints. Medians differ more between two estimates of one person.
    """
    places: Array = np.nanmean(positions[..., :2], axis=1)
    return places
