"""Bone lengths of a person, learnt online as clipped means of measured lengths; compiled.

Tracking learns them from the joints of single instants, refinement from smoothed joints.
"""

from __future__ import annotations

import numpy as np

from panoptic_ros.domain import JointState
from panoptic_ros.kernels import njit

MEASURED = int(JointState.MEASURED)
GOOD_SIGMA = 0.04  # m per axis, standard deviation (RMS over both ends) up to which a bone is learnt
SHORTEST = 1e-3  # m, length below which a bone has no direction
OUTLIER = 3.0  # standard deviations at which the difference of a length from the mean is clipped
EXTRA_SIGMA = 0.01  # m, standard deviation of a length for clipping, in addition to the noise of its ends
SETTLED = 5.0  # measurements after which outliers are clipped


@njit(cache=True, error_model="numpy")
def learn_lengths(positions, covariances, states, bones, memory, lengths, counts, squares):
    """Update the mean lengths of one person's bones with one more measurement of its joints, in place.

    The mean of |a - b| over noisy joints exceeds the true length by the noise across the bone, so this excess
    is subtracted. A bone is learnt where both ends are measured and certain enough.

    Args:
        positions: (J, 3) m.
        covariances: (J, 3, 3) m^2.
        states: (J,) of `JointState`.
        bones: (B, 2) joints at the ends.
        memory: number of measurements over which a length is averaged.
        lengths: (B,) m, updated.
        counts: (B,) number of measurements of each bone, updated.
        squares: (B,) m^2, mean squared deviation of single measurements from the mean, updated.
    """
    offset = np.empty(3)
    for i in range(len(bones)):
        a, b = bones[i]
        if states[a] != MEASURED or states[b] != MEASURED:
            continue
        length = distance(positions, a, b, offset)
        trace = along = 0.0
        for k in range(3):
            trace += covariances[a, k, k] + covariances[b, k, k]
            for m in range(3):
                along += offset[k] * (covariances[a, k, m] + covariances[b, k, m]) * offset[m]
        if not (trace <= 6.0 * GOOD_SIGMA**2 and length >= SHORTEST):  # NaN fails this test
            continue
        along /= length**2
        length -= 0.5 * (trace - along) / length
        counts[i] = min(counts[i] + 1.0, memory)
        if counts[i] == 1.0:
            lengths[i] = length
            continue
        gap = length - lengths[i]
        if counts[i] > SETTLED:
            limit = OUTLIER * np.sqrt(along + EXTRA_SIGMA**2)
            gap = min(limit, max(-limit, gap))
        lengths[i] += gap / counts[i]
        squares[i] += (gap * gap - squares[i]) / (counts[i] - 1.0)


@njit(cache=True, error_model="numpy")
def distance(positions, a, b, offset):
    """Return the distance, m, of joints a and b of positions (J, 3); offset (3,) m becomes b - a."""
    for k in range(3):
        offset[k] = positions[b, k] - positions[a, k]
    return np.sqrt(offset[0] ** 2 + offset[1] ** 2 + offset[2] ** 2)
