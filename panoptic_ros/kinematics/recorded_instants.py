"""Data of a whole recording at instants of a fixed rate."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from panoptic_ros.domain.subjects import ImuSeries, Instant, ViewSeries
from panoptic_ros.kinematics.imus.resampling import resample
from panoptic_ros.kinematics.people.between_images import views_at

Array = np.ndarray


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
