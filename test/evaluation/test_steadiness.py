"""Steadiness of motion that is known."""

import numpy as np
import pytest

from panoptic_ros.evaluation.steadiness import FEWEST, slow_motion, steadiness

RATE, FRAMES = 50.0, 200
STAMPS = np.round(1e9 * np.arange(FRAMES) / RATE).astype(np.int64)
LIMBS = np.array([[0, 1], [1, 2]])
STILL = np.tile([[0.0, 0.0, 0.0], [0.3, 0.0, 0.0], [0.6, 0.0, 0.0]], (FRAMES, 1, 1))


def alternating(size):
    """Noise m that is opposite from instant to instant: accelerations of 4 size rate^2."""
    return size * (-1.0) ** np.arange(FRAMES)


def test_noise_of_somebody_who_stands_is_all_of_the_acceleration():
    shaken = STILL.copy()
    shaken[..., 2] += alternating(0.001)[:, None]
    told = steadiness(STAMPS, shaken, slow_motion(STAMPS, STILL), LIMBS)
    assert told.acceleration == pytest.approx(4.0 * 0.001 * RATE**2)
    assert told.noise == pytest.approx(told.acceleration)
    assert told.limb_median_cm == pytest.approx(0.0, abs=1e-9) and told.instants == FRAMES


def test_slow_motion_is_no_noise():
    swing = STILL.copy()
    swing[..., 1] += 0.2 * np.sin(2.0 * np.pi * 1.0 * STAMPS * 1e-9)[:, None]
    told = steadiness(STAMPS, swing, slow_motion(STAMPS, swing), LIMBS)
    assert told.acceleration == pytest.approx(0.2 * (2.0 * np.pi) ** 2 * np.sqrt(0.5), rel=0.05)
    assert told.noise < 0.05 * told.acceleration
    shaken = swing.copy()
    shaken[..., 2] += alternating(0.001)[:, None]
    both = steadiness(STAMPS, shaken, slow_motion(STAMPS, swing), LIMBS)
    # the median of sums of squares is near the sum of the medians
    assert both.noise == pytest.approx(4.0 * 0.001 * RATE**2, rel=0.05)


def test_limbs_vary_by_what_they_are_moved_along_themselves():
    moved = STILL.copy()
    moved[:, 2, 0] += alternating(0.004)  # the second limb alone
    told = steadiness(STAMPS, moved, slow_motion(STAMPS, STILL), LIMBS)
    assert told.limb_worst_cm == pytest.approx(0.4) and told.limb_median_cm == pytest.approx(0.2)


def test_what_is_missing_is_not_told():
    gone = STILL.copy()
    gone[5, 2] = np.nan
    slow = slow_motion(STAMPS, gone)
    assert np.isfinite(slow[:, :2]).all() and np.isnan(slow[:, 2]).all()
    gone[:-10, 0] = np.nan
    told = steadiness(STAMPS, gone, slow, LIMBS)
    assert told.limb_worst_cm == told.limb_median_cm == pytest.approx(0.0, abs=1e-9)
    nothing = steadiness(STAMPS, np.full_like(gone, np.nan), slow, LIMBS)
    assert nothing.instants == 0 and np.isnan([nothing.noise, nothing.limb_worst_cm]).all()
    with pytest.raises(ValueError, match="too few"):
        slow_motion(STAMPS[: FEWEST - 1], STILL[: FEWEST - 1])
