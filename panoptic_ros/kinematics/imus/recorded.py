"""Checks of recorded IMU samples before a recording is solved.

Each fault of a device is reported once and does not affect the other devices.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from panoptic_ros.domain.subjects import ImuSeries
from panoptic_ros.geometry.rotations import from_quaternions
from panoptic_ros.kinematics.imus.measured import LONGEST_GAP_S
from panoptic_ros.kinematics.imus.streams import (
    ALIKE,
    GRAVITY,
    LEAST_RATE,
    NEAREST_NS,
    SILENT_NS,
    UPRIGHT,
    UPRIGHT_S,
    rate_sums,
    turned_by,
    unit_fault,
)

Array = np.ndarray
FEWEST = 10  # minimum number of samples of a usable device


def looked_through(
    devices: Mapping[str, ImuSeries], time: tuple[int, int] | None = None
) -> tuple[dict[str, ImuSeries], list[str]]:
    """Return the usable devices with their usable samples, and lines about faults.

    There is one line per fault, with all devices that have it.

    Args:
        time: Begin and end of the cameras, ns; None without cameras.
    """
    found, told = {}, dict[str, list[str]]()
    end = max((int(s.stamps[-1]) for s in devices.values() if len(s.stamps)), default=0)
    end = min(end, time[1]) if time is not None else end
    for name, series in devices.items():
        kept, odd = _usable(series, end)
        useless = _useless(kept, time)
        if useless:
            odd = [f"{useless}; it is left out"]
        else:
            found[name] = kept
            odd += [fault] if (fault := unit_fault(_rates(kept))) else []
        for text in odd:
            told.setdefault(text, []).append(name)
    return found, [f"{', '.join(names)} {text}" for text, names in told.items()]


def _usable(series: ImuSeries, end_ns: int) -> tuple[ImuSeries, list[str]]:
    """Return the usable samples and lines about faults.

    There are at most 500 samples per second. Invalid quaternions become NaN.
    """
    lines = []
    kept = _spaced(series.stamps)
    if len(kept) < len(series.stamps):
        dropped = len(series.stamps) - len(kept)
        lines.append(f"sends more than {1e9 / NEAREST_NS:.0f} samples/s; {dropped} are left out")
    quaternions, rates, forces = (
        part[kept].copy() for part in (series.quaternions, series.rates, series.forces)
    )
    with np.errstate(invalid="ignore"):
        known = np.linalg.norm(quaternions, axis=-1) > 1e-3
    quaternions[~known] = np.nan
    if not known.all():
        lines.append(f"has no orientation in {int((~known).sum())} of {len(known)} samples")
    found = ImuSeries(series.stamps[kept], quaternions, rates, forces)
    told = found.stamps[known]
    gaps = np.diff(np.append(told, max(end_ns, int(told[-1])))) if len(told) else np.zeros(0)
    if len(gaps) and gaps.max() > SILENT_NS:
        k = int(np.argmax(gaps))
        since = 1e-9 * (int(told[k]) - int(told[0]))
        lines.append(
            f"is silent for {1e-9 * gaps[k]:.1f} s, {since:.1f} s after its first sample; bodies are "
            "solved without it"
        )
    return found, lines


def _spaced(stamps: Array) -> Array:
    """Return the rows of samples that are not too close in time to the last selected one."""
    if not len(stamps) or (np.diff(stamps) >= NEAREST_NS).all():
        return np.arange(len(stamps))
    kept, last = [0], int(stamps[0])
    for k, stamp in enumerate(stamps.tolist()):
        if stamp - last >= NEAREST_NS:
            kept.append(k)
            last = stamp
    return np.array(kept)


def _useless(series: ImuSeries, time: tuple[int, int] | None) -> str:
    """Return why a device cannot be used, or "" if it can."""
    if len(series.stamps) < FEWEST:
        return f"has {len(series.stamps)} samples that can be used"
    if time is not None and (series.stamps[-1] < time[0] or series.stamps[0] > time[1]):
        return "has no samples in the time of the cameras"
    known = np.isfinite(series.quaternions).all(-1) & np.isfinite(series.forces).all(-1)
    lasted = 1e-9 * (int(series.stamps[-1]) - int(series.stamps[0]))
    if known.sum() < FEWEST or lasted < UPRIGHT_S:
        return ""
    turned = from_quaternions(series.quaternions[known])
    if _turns_otherwise(_rates(series)):
        return "rotates by its quaternions (w x y z, into its inertial frame) differently than by its rates"
    force = (turned @ series.forces[known][..., None])[..., 0].mean(0)
    if np.linalg.norm(force - GRAVITY) <= UPRIGHT:
        return ""
    mean = np.array2string(force, precision=1)
    return (
        f"measures a mean force of {mean} m/s^2 in its inertial frame, expected (0, 0, 9.81): z up, "
        "quaternions that turn device vectors into it, m/s^2, gravity not subtracted"
    )


def _rates(series: ImuSeries) -> Array:
    """Return the sums that compare rates of orientations and of the gyroscope, see `rate_sums`."""
    known = np.isfinite(series.quaternions).all(-1)
    stamps, told = series.stamps[known], series.rates[known][:-1]
    if len(stamps) < 2:
        return np.zeros(4)
    turns, apart = series.quaternions[known], 1e-9 * np.diff(stamps)
    near = (apart < LONGEST_GAP_S) & np.isfinite(told).all(-1)
    own = turned_by(turns[:-1][near], turns[1:][near], apart[near])
    found: Array = rate_sums(own, told[near]).sum(0)
    return found


def _turns_otherwise(sums: Array) -> bool:
    """Return whether the gyroscope's rates, in any unit, disagree with the rotation of the orientations."""
    count, own, told, both = sums.tolist()
    if count < FEWEST or own < count * LEAST_RATE**2 or not told:
        return False
    return bool(both < ALIKE * np.sqrt(own * told))
