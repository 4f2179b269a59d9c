"""Bone lengths of people: learnt online, then applied as soft constraints on the joints; compiled."""

from __future__ import annotations

import numpy as np

from panoptic_ros.geometry.robust import noise_growth
from panoptic_ros.identity.bone_lengths import SHORTEST, distance, learn_lengths
from panoptic_ros.kernels import njit
from panoptic_ros.refinement import fading
from panoptic_ros.refinement.joint_states import MISSING, SmoothedJoints
from panoptic_ros.refinement.records import FilterState, PeopleStatistics

Array = np.ndarray

MEMORY = 300.0  # frames, memory of the mean of a bone length
OUTLIER = 3.0  # standard deviations, scale of the Cauchy weight of a bone's residual


def on_bones(
    judged: SmoothedJoints,
    people: PeopleStatistics,
    bones: Array,
    config: tuple[float, int],
    lasting: Array | None,
    target: FilterState,
) -> None:
    """Learn bone lengths into `people`, then move the joints in `judged` towards these lengths.

    Persistent errors of joints change the bones as well. The covariances of the filter do not contain these
    errors, and they are small where the surface shows the motion of joints. So the correction is computed
    twice: with the covariances of the filter, and with persistent errors added. The difference between both
    corrections is applied gradually (`fading.SLOW_BONES`), else a shaking joint would shake its neighbours. A
    bone with uncertain ends does not change its learnt length.

    Args:
        judged: Joints of all people; positions and covariances are updated.
        people: Learnt values; bone lengths and `pulled` are updated.
        bones: (B, 2) joints at the ends.
        config: `bone_sigma`, m, and `bone_frames`.
        lasting: (P, J, 3, 3) m^2, covariances of persistent errors, None = no such errors. The resulting
            covariances are those of the filter, without these errors.
        target: The moment of the joints.
    """
    (places, spreads, _, states), (sigma, fewest) = judged, config
    whole = spreads if lasting is None else spreads + lasting
    learn_people(places, whole, states, bones, people.lengths, people.frames, people.squares)
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
def learn_people(places, spreads, states, bones, lengths, frames, squares):
    """Update `lengths` (P, B) m, the bone lengths of all people, and their numbers; see `learn_lengths`."""
    for p in range(len(places)):
        learn_lengths(places[p], spreads[p], states[p], bones, MEMORY, lengths[p], frames[p], squares[p])


@njit(cache=True, error_model="numpy")
def pull_bones(positions, covariances, states, bones, lengths, sigma):
    """Update joint positions and covariances with bone lengths (P, B) m as measurements; NaN = unknown.

    One pass follows the tree from the root. Each bone is a scalar measurement of both its ends, and the less
    certain end moves more. A Cauchy weight reduces the influence of outliers.

    Args:
        sigma: m, standard deviation of the lengths.
    """
    offset, gain_a, gain_b = np.empty(3), np.empty(3), np.empty(3)
    for p, i in np.ndindex(lengths.shape):
        a, b = bones[i]
        if np.isnan(lengths[p, i]) or states[p, a] == MISSING or states[p, b] == MISSING:
            continue
        length, expected = distance(positions[p], a, b, offset), 0.0
        if length < SHORTEST:
            continue
        for k in range(3):
            gain_a[k] = gain_b[k] = 0.0
            for m in range(3):
                gain_a[k] += covariances[p, a, k, m] * offset[m] / length
                gain_b[k] += covariances[p, b, k, m] * offset[m] / length
            expected += offset[k] / length * (gain_a[k] + gain_b[k])
        innovation = lengths[p, i] - length
        noise = sigma**2 * noise_growth(innovation**2 / (expected + sigma**2), OUTLIER)
        total = expected + noise
        for k in range(3):
            positions[p, a, k] -= gain_a[k] * innovation / total
            positions[p, b, k] += gain_b[k] * innovation / total
            for m in range(3):
                covariances[p, a, k, m] -= gain_a[k] * gain_a[m] / total
                covariances[p, b, k, m] -= gain_b[k] * gain_b[m] / total
