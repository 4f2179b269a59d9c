"""How steady somebody is where there is no truth: lengths of limbs, and accelerations that nobody makes.

Limbs do not change their lengths. Motion below 6 Hz is taken for real (Winter 2009, 3.4.3, finds 99 % of the
power of gait below it); the rest of what is typical of accelerations is noise, in squares, as the two are not
correlated. Slow motion is that of the steadiest way that there is, the same for all ways.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from panoptic_ros.evaluation.capture_report import typical_acceleration

Array = np.ndarray
SLOW = 6.0  # Hz
ORDER = 4  # of Butterworth's filter, which runs forward and back
FEWEST = 30  # instants of somebody who is told of


@dataclass(frozen=True, slots=True)
class Steadiness:
    """Of one person; NaN where nothing tells.

    Args:
        instants: in which the person is there. acceleration: m/s^2, median over joints that are always there.
        noise: m/s^2, of it what slow motion does not explain. limb_median_cm, limb_worst_cm: median and
            largest standard deviation of the lengths of limbs.
    """

    instants: int
    acceleration: float
    noise: float
    limb_median_cm: float
    limb_worst_cm: float


def slow_motion(stamps_ns: Array, positions: Array) -> Array:
    """Positions (F, J, 3) m without what is quicker than `SLOW`; joints that are missing at times are NaN.

    Raises:
        ValueError: if there are fewer than `FEWEST` instants.
    """
    from scipy.signal import butter, filtfilt  # takes a second to load, which most runs do not need

    if len(positions) < FEWEST:
        raise ValueError(f"{len(positions)} instants are too few")
    rate = 1e9 / float(np.median(np.diff(stamps_ns)))
    slow, known = np.full(positions.shape, np.nan), np.isfinite(positions).all(axis=(0, 2))
    if rate > 2.0 * SLOW:
        slow[:, known] = filtfilt(*butter(ORDER, 2.0 * SLOW / rate), positions[:, known], axis=0)
    return slow


def steadiness(stamps_ns: Array, positions: Array, slow: Array, limbs: Array) -> Steadiness:
    """Of joints (F, J, 3) m, NaN = missing, beside their slow motion (F, J, 3) m.

    limbs: (L, 2) joints.
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
