"""Data of a whole recording at instants of a fixed rate.

2D people of a camera at instants between its images have each joint on the line between two images, as in
the live system of Malleson et al. 2020. Whoever is in both images is the one who is nearest in the other;
who is in one alone counts near to it.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from panoptic_ros.domain.subjects import ImuSeries, Instant, ViewPeople, ViewSeries
from panoptic_ros.kinematics.body.sight import FEWEST
from panoptic_ros.kinematics.imus.measured import resample
from panoptic_ros.kinematics.people.seen_people import (
    LONGEST_GAP_NS,
    NEAR_NS,
    SeenPoints,
    joints_between,
)

Array = np.ndarray

SAME_SHARE = 0.25  # of the size of a 2D person, by which one moves from an image to the next, at most


def views_at(series: ViewSeries, stamps: Array, half_period_ns: int) -> list[ViewPeople | None]:
    """2D people at instants (T,) ns; None where there is no image around an instant and none within half a
    period."""
    pairs: dict[int, list[tuple[int, int]]] = {}  # rows of the same people, by the later image
    found: list[ViewPeople | None] = []
    for stamp, end in zip(stamps.tolist(), np.searchsorted(series.stamps, stamps - NEAR_NS).tolist()):
        near = [k for k in (end, end - 1) if 0 <= k < len(series.stamps)]
        apart = [abs(int(series.stamps[k]) - stamp) for k in near]
        if apart and min(apart) > NEAR_NS and sum(apart) <= LONGEST_GAP_NS and len(near) == 2:
            if end not in pairs:
                pairs[end] = same_people(series.people[end - 1], series.people[end])
            found.append(_between(series, end, pairs[end], stamp, half_period_ns))
        elif apart and min(apart) <= half_period_ns:
            found.append(series.people[near[int(np.argmin(apart))]])
        else:
            found.append(None)
    return found


def same_people(before: ViewPeople, after: ViewPeople) -> list[tuple[int, int]]:
    """Rows of those who are in both images, the nearest first."""
    claims = []
    for p, one in enumerate(before.points):
        seen = np.isfinite(one).all(-1)
        for q, other in enumerate(after.points):
            both = seen & np.isfinite(other).all(-1)
            if both.sum() >= FEWEST:
                apart = float(np.median(np.linalg.norm(one[both] - other[both], axis=-1)))
                claims.append((apart / float(np.ptp(one[seen], axis=0).max()), p, q))
    found = list[tuple[int, int]]()
    for apart, p, q in sorted(claims):
        if apart < SAME_SHARE and all(p != other[0] and q != other[1] for other in found):
            found.append((p, q))
    return found


def _between(
    series: ViewSeries, end: int, pairs: list[tuple[int, int]], stamp: int, half_period_ns: int
) -> ViewPeople:
    """People between an image and the one before."""
    images = [(int(series.stamps[k]), series.people[k]) for k in (end - 1, end)]
    rows = []
    for pair in pairs:
        both = [SeenPoints(at, p.points[row], p.scores[row]) for (at, p), row in zip(images, pair)]
        seen = joints_between(both[0], both[1], stamp, half_period_ns)
        rows += [] if seen is None else [seen]
    for k, (at, people) in enumerate(images):
        if abs(stamp - at) <= half_period_ns:
            alone = set(range(len(people.points))) - {pair[k] for pair in pairs}
            rows += [(people.points[row], people.scores[row]) for row in sorted(alone)]
    joints = images[0][1].points.shape[1]
    points = np.array([points for points, _ in rows]).reshape(-1, joints, 2)
    return ViewPeople(points, np.array([scores for _, scores in rows]).reshape(-1, joints))


def instants_of(
    views: Mapping[int, ViewSeries], devices: Mapping[str, ImuSeries], rate_hz: float
) -> list[Instant]:
    """All data at instants of a fixed rate, from the first camera's first image on, or the first IMU sample.

    2D joints lie on the line between the images around an instant; IMUs are interpolated, orientations along
    the arc (slerp), where samples lie on both sides.
    """
    series = [v.stamps for v in views.values() if len(v.stamps)] or [
        d.stamps for d in devices.values() if len(d.stamps)
    ]
    if not series:
        return []
    first, last = min(int(s[0]) for s in series), max(int(s[-1]) for s in series)
    count = int(np.floor((last - first) * 1e-9 * rate_hz + 0.5)) + 1
    stamps = first + np.round(np.arange(count) * 1e9 / rate_hz).astype(np.int64)
    half_period_ns = round(0.5e9 / rate_hz)
    seen = {camera: views_at(view, stamps, half_period_ns) for camera, view in views.items()}
    readings = {name: resample(device, stamps) for name, device in devices.items()}
    found = []
    for k, stamp in enumerate(stamps):
        people = {camera: one for camera, rows in seen.items() if (one := rows[k]) is not None}
        there = {name: reading for name, rows in readings.items() if (reading := rows[k]) is not None}
        found.append(Instant(int(stamp), people, there))
    return found
