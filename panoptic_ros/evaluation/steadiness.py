"""Smoothness of a person's motion without ground truth.

It is measured by the constancy of limb lengths, and by implausible accelerations.

Limbs do not change their lengths. Motion below 6 Hz is treated as real; Winter 2009, 3.4.3, finds 99 % of the
power of gait below it. The remaining part of the typical acceleration is noise. Squares are subtracted,
because both parts are uncorrelated. All compared methods use the same slow motion, that of the method with
the smoothest result.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from panoptic_ros.evaluation.capture_report import typical_acceleration

Array = np.ndarray
SLOW = 6.0  # Hz; upper limit of real motion
ORDER = 4  # order of the Butterworth filter, which runs forwards and backwards
FEWEST = 30  # smallest number of instants of a person or bone


@dataclass(frozen=True, slots=True)
class Steadiness:
    """Smoothness of one person; NaN where it is undefined.

    Args:
        instants: Number of instants with the person.
        acceleration: Median over joints that are present at all instants, m/s^2.
        noise: Part of the acceleration that slow motion does not explain, m/s^2.
        limb_median_cm, limb_worst_cm: Median and largest standard deviation of limb lengths, cm.
    """

    instants: int
    acceleration: float
    noise: float
    limb_median_cm: float
    limb_worst_cm: float


def slow_motion(stamps_ns: Array, positions: Array) -> Array:
    """Return positions (F, J, 3) m without motion faster than `SLOW`.

    Joints that are missing at any instant are NaN. All joints are NaN if the rate is at most 2 * `SLOW`.

    Raises:
        ValueError: For fewer than `FEWEST` instants.
    """
    from scipy.signal import butter, filtfilt  # takes a second to load, and most runs do not need it

    if len(positions) < FEWEST:
        raise ValueError(f"{len(positions)} instants are too few")
    rate = 1e9 / float(np.median(np.diff(stamps_ns)))
    slow, known = np.full(positions.shape, np.nan), np.isfinite(positions).all(axis=(0, 2))
    if rate > 2.0 * SLOW:
        slow[:, known] = filtfilt(*butter(ORDER, 2.0 * SLOW / rate), positions[:, known], axis=0)
    return slow


def steadiness(stamps_ns: Array, positions: Array, slow: Array, limbs: Array) -> Steadiness:
    """Return the smoothness of one person's joints.

    Args:
        stamps_ns: Timestamps (F,), increasing.
        positions: Joints (F, J, 3) m, NaN = missing.
        slow: Their slow motion (F, J, 3) m, see `slow_motion`.
        limbs: Joint pairs (L, 2) of the limbs.
    """
    known = np.isfinite(slow[0, :, 0])
    acceleration = typical_acceleration(stamps_ns, positions[:, known])
    real = typical_acceleration(stamps_ns, slow[:, known])
    lengths = 100.0 * np.linalg.norm(positions[:, limbs[:, 1]] - positions[:, limbs[:, 0]], axis=-1)
    told = np.isfinite(lengths).sum(axis=0) >= FEWEST
    spreads = np.nanstd(lengths[:, told], axis=0)
    return Steadiness(
        int(np.isfinite(positions[..., 0]).any(axis=1).sum()),
        acceleration,
        float(np.sqrt(np.maximum(0.0, acceleration**2 - real**2))),
        float(np.median(spreads)) if spreads.size else float("nan"),
        float(spreads.max()) if spreads.size else float("nan"),
    )
