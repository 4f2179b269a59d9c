"""Lengths of people's bones: learnt online, then soft constraints on the joints; compiled."""

from __future__ import annotations

import numpy as np

from panoptic_ros.kernels import njit
from panoptic_ros.refinement import fading
from panoptic_ros.refinement.joint_states import MEASURED, MISSING, Judged
from panoptic_ros.refinement.records import Moment, People

Array = np.ndarray

MEMORY = 300.0  # frames over which a length is averaged
GOOD_SIGMA = 0.04  # m, joints less certain than this are not learnt from
OUTLIER = 3.0  # sigmas from the mean, beyond which a length has less weight
SHORTEST = 1e-3  # m, below which a bone has no direction
EXTRA_SIGMA = 0.01  # m, of a length besides the noise of its ends, when outliers are judged
SETTLED = 5.0  # frames after which outliers are cut


def on_bones(
    judged: Judged,
    people: People,
    bones: Array,
    config: tuple[float, int],
    lasting: Array | None,
    target: Moment,
) -> None:
    """Learn the lengths of bones (B, 2), and put joints on bones of the learnt lengths, in place.

    Bones are as wrong as errors that last make them, too: those of the filter are small where the surface
    shows how joints move. What only these explain is followed gradually: else joints that shake make their
    neighbours shake. Lengths of bones whose ends err much are not learnt.

    Args:
        config: m and frames, `bone_sigma` and `bone_frames`. lasting: (P, J, 3, 3) m^2, of errors that last;
            covariances stay those of the filter. None = there are none.
        target: the moment.
    """
    (places, spreads, _, states), (sigma, fewest) = judged, config
    whole = spreads if lasting is None else spreads + lasting
    learn_lengths(places, whole, states, bones, people.lengths, people.frames)
    settled = np.where(people.frames >= fewest, people.lengths, np.nan)
    if lasting is None:
        pull_bones(places, spreads, states, bones, settled, sigma)
        return
    quick = places.copy()
    pull_bones(quick, spreads, states, bones, settled, sigma)
    pull_bones(places, whole, states, bones, settled, sigma)
    change = places - quick - people.pulled
    places -= fading.not_yet(change, target.linked, target.dt, fading.SLOW_BONES)
    people.pulled[...] = places - quick


@njit(cache=True, error_model="numpy")
def learn_lengths(positions, covariances, states, bones, lengths, frames):
    """Update the mean lengths (P, B) m, and of how many frames they are (P, B), in place.

    The mean of |a - b| over noisy joints is too long by the noise across the bone; that is
    subtracted.
    """
    offset = np.empty(3)
    for p, i in np.ndindex(lengths.shape):
        a, b = bones[i]
        if states[p, a] != MEASURED or states[p, b] != MEASURED:
            continue
        length, trace, along = _length(positions[p], a, b, offset), 0.0, 0.0
        for k in range(3):
            trace += covariances[p, a, k, k] + covariances[p, b, k, k]
            for m in range(3):
                spread = covariances[p, a, k, m] + covariances[p, b, k, m]
                along += offset[k] * spread * offset[m]
        if trace > 6.0 * GOOD_SIGMA**2 or length < SHORTEST:
            continue
        along /= offset[0] ** 2 + offset[1] ** 2 + offset[2] ** 2
        frames[p, i] = min(frames[p, i] + 1.0, MEMORY)
        innovation = length - 0.5 * (trace - along) / length - lengths[p, i]
        limit = OUTLIER * np.sqrt(along + EXTRA_SIGMA**2)
        if frames[p, i] > SETTLED:
            innovation = min(limit, max(-limit, innovation))
        lengths[p, i] += innovation / frames[p, i]


@njit(cache=True, error_model="numpy")
def pull_bones(positions, covariances, states, bones, lengths, sigma):
    """Take lengths (P, B) m, NaN = not known, as measurements of noise sigma m, in place.

    One pass along the tree from the root, each bone a scalar measurement of both ends, the less certain of
    which moves more.
    """
    offset, gain_a, gain_b = np.empty(3), np.empty(3), np.empty(3)
    for p, i in np.ndindex(lengths.shape):
        a, b = bones[i]
        if np.isnan(lengths[p, i]) or states[p, a] == MISSING or states[p, b] == MISSING:
            continue
        length, expected = _length(positions[p], a, b, offset), 0.0
        if length < SHORTEST:
            continue
        for k in range(3):
            gain_a[k] = gain_b[k] = 0.0
            for m in range(3):
                gain_a[k] += covariances[p, a, k, m] * offset[m] / length
                gain_b[k] += covariances[p, b, k, m] * offset[m] / length
            expected += offset[k] / length * (gain_a[k] + gain_b[k])
        innovation = lengths[p, i] - length
        noise = sigma**2 * (1.0 + innovation**2 / (OUTLIER**2 * (expected + sigma**2)))
        total = expected + noise
        for k in range(3):
            positions[p, a, k] -= gain_a[k] * innovation / total
            positions[p, b, k] += gain_b[k] * innovation / total
            for m in range(3):
                covariances[p, a, k, m] -= gain_a[k] * gain_a[m] / total
                covariances[p, b, k, m] -= gain_b[k] * gain_b[m] / total


@njit(cache=True, error_model="numpy")
def _length(positions, a, b, offset):
    """Length m of the bone from joint a to b; offset (3,) m becomes that of its ends."""
    for k in range(3):
        offset[k] = positions[b, k] - positions[a, k]
    return np.sqrt(offset[0] ** 2 + offset[1] ** 2 + offset[2] ** 2)
