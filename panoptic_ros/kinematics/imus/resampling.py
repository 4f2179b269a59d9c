"""Data of devices and cameras at instants of a fixed rate."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from panoptic_ros.domain.subjects import ImuReading, ImuSeries, Instant, ViewPeople, ViewSeries
from panoptic_ros.geometry.rotations import from_quaternions

Array = np.ndarray
LONGEST_GAP_S = 0.1  # between two samples of an IMU, over which it is interpolated


def instants_of(
    views: Mapping[int, ViewSeries], devices: Mapping[str, ImuSeries], rate_hz: float
) -> list[Instant]:
    """All data at instants of a fixed rate, from the first camera's first image on, or the first IMU sample.

    A sample of a camera belongs to the nearest instant within half a period; IMUs are interpolated,
    orientations along the arc (slerp), where samples lie on both sides.
    """
    series = [v.stamps for v in views.values() if len(v.stamps)] or [
        d.stamps for d in devices.values() if len(d.stamps)
    ]
    if not series:
        return []
    first, last = min(int(s[0]) for s in series), max(int(s[-1]) for s in series)
    count = int(np.floor((last - first) * 1e-9 * rate_hz + 0.5)) + 1
    stamps = first + np.round(np.arange(count) * 1e9 / rate_hz).astype(np.int64)
    seen: list[dict[int, ViewPeople]] = [{} for _ in stamps]
    for camera, view in views.items():
        places = np.floor((view.stamps - first) * 1e-9 * rate_hz + 0.5).astype(np.int64)
        far = np.abs(view.stamps - stamps[np.clip(places, 0, count - 1)])
        for n in np.argsort(-far, kind="stable"):  # the nearest last
            if 0 <= places[n] < count:
                seen[places[n]][camera] = view.people[n]
    readings = {name: resample(device, stamps) for name, device in devices.items()}
    found = []
    for k, stamp in enumerate(stamps):
        there = {name: reading for name, rows in readings.items() if (reading := rows[k]) is not None}
        found.append(Instant(int(stamp), seen[k], there))
    return found


def resample(series: ImuSeries, stamps: Array) -> list[ImuReading | None]:
    """A device at instants (T,) ns; None where it has no samples around."""
    if len(series.stamps) < 2:
        return [None] * len(stamps)
    after = np.clip(np.searchsorted(series.stamps, stamps), 1, len(series.stamps) - 1)
    before = after - 1
    gap = series.stamps[after] - series.stamps[before]
    share = (stamps - series.stamps[before]) / np.maximum(gap, 1)
    usable = (share > -0.5) & (share < 1.5) & (gap < LONGEST_GAP_S * 1e9)
    share = np.clip(share, 0.0, 1.0)[:, None]
    begin, end = series.quaternions[before], series.quaternions[after]
    along = slerp(begin, end, share)
    forces = series.forces[before] * (1 - share) + series.forces[after] * share
    rates = series.rates[before] * (1 - share) + series.rates[after] * share
    with np.errstate(invalid="ignore"):
        turned = from_quaternions(along)
    return [ImuReading(turned[k], forces[k], rates[k]) if usable[k] else None for k in range(len(stamps))]


def slerp(begin: Array, end: Array, share: Array) -> Array:
    """Quaternions (N, 4) between two (N, 4), along the shorter arc, at shares (N, 1)."""
    cosine = (begin * end).sum(-1, keepdims=True)
    end = np.where(cosine < 0.0, -end, end)
    angle = np.arccos(np.clip(np.abs(cosine), 0.0, 1.0))
    flat = angle < 1e-4
    sine = np.where(flat, 1.0, np.sin(angle))
    found: Array = np.where(
        flat,
        (1 - share) * begin + share * end,
        (np.sin((1 - share) * angle) * begin + np.sin(share * angle) * end) / sine,
    )
    return found
