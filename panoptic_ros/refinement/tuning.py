"""Process noise and the scale of covariances, learnt online from the innovations of a filter.

Innovations, whitened by their stated covariance, of a filter whose model is right have variance 1 and
no correlation over time (Mehra 1970). If two in a row point the same way, the filter follows too slowly
and needs more process noise; if they alternate, it follows noise and needs less. That does not depend on
the scale of the noise. With process noise so, their mean square tells the scale of all covariances.

Errors of a detector that last for some frames look like motion: then innovations two and three frames
apart have opposite signs, because the filter follows an error and comes back. Smoothed joints are then less
certain. By how much was found approximately, by simulation of such errors.
"""

from __future__ import annotations

import numpy as np

from panoptic_ros.kernels import njit
from panoptic_ros.refinement.records import People

Array = np.ndarray

TOP_SPEED = 3.0  # m/s against the body; more is noise
CLIP = 3.0  # sigmas, at which innovations are clipped
FIRST = 4  # measurements of a person before process noise is learnt
SETTLED = 10  # and before the scale is; earlier innovations depend on the prior of velocities
RATE = 0.2  # of the logarithm of the process noise, per measurement and unit of correlation
JOINT_RATE, PERSON_RATE = 0.05, 0.1  # the same by displacements: of a joint's own, and of all of a person's
# Correlation of a joint's displacements with which its process noise is large enough, and s between them.
SMOOTH, SMOOTH_AFTER = 0.35, 0.04
RANGE = (0.1, 10.0)  # of the factor on the process noise
MEMORY = 100.0  # measurements of a person
LASTING_PRIOR, LASTING_MEMORY = 60.0, 1000.0  # measurements of people
LASTING_FREE = 0.06  # correlation, two and three frames apart, that is no sign of lasting errors
LASTING_GAIN = 8.0  # growth of covariances per unit of it beyond


def nothing_lasting() -> Array:
    """Weight and correlation of errors that last, which belong to the detector: what `learn` begins from."""
    return np.array([LASTING_PRIOR, 0.0])


def scales(people: People, lasting: Array) -> Array:
    """(P,) by which covariances of the filter and smoother are to be multiplied."""
    scaled: Array = people.levels * (1.0 + LASTING_GAIN * max(0.0, -float(lasting[1]) - LASTING_FREE))
    return scaled


def learn(people: People, seen: Array, innovations: Array, lasting: Array) -> None:
    """Take whitened innovations (P, J, 3), NaN = not measured, of the people that are seen (P,), in place.

    The process noise of joints whose displacements were measured on the surface is left to `learn_turns`.
    """
    changes = np.zeros(len(seen))
    learn_levels(people, seen, innovations, lasting, changes)
    _change(people, np.where(np.isfinite(people.turns[..., 0]), 0.0, changes[:, None]))


def learn_turns(people: People, innovations: Array, dt: float) -> None:
    """Take whitened innovations (P, J, 3) of displacements over dt s, NaN = not measured, in place.

    They tell the process noise as those of positions do, and better: errors of a detector last, and their
    innovations point the same way whatever the process noise is; errors of displacements do not. They are
    exact enough to tell that of single joints: an arm swings while the legs stand. People move more smoothly
    than by accelerations at random, so the innovations of a joint that swings point the same way for long:
    the more alike, the sooner the next image comes. A joint whose correlation is below that of `SMOOTH` needs
    less noise than the rest of the person.
    """
    changes = np.zeros(innovations.shape[:2])
    turn_correlations(people.turns, innovations, SMOOTH ** (dt / SMOOTH_AFTER), changes)
    _change(people, changes)
    people.turns[:] = innovations


def _change(people: People, changes: Array) -> None:
    """Change the logarithms of the factors by changes (P, J), in place."""
    people.factors[:] = np.minimum(np.maximum(people.factors * np.exp(changes), RANGE[0]), RANGE[1])


@njit(cache=True, error_model="numpy")
def turn_correlations(before, now, smooth, changes):
    """Changes (P, J) of logarithms by whitened innovations (P, J, 3) and those before.

    Those of joints that were not measured twice change with those of the person alone.

    smooth: correlation of a joint whose noise is large enough.
    """
    for p in range(len(now)):
        product = square = 0.0
        count = 0
        for j in range(now.shape[1]):
            changes[p, j] = 0.0
            if np.isfinite(now[p, j, 0] + before[p, j, 0]):
                count += 1
                own = size = 0.0
                for i in range(3):
                    a = min(CLIP, max(-CLIP, before[p, j, i]))
                    b = min(CLIP, max(-CLIP, now[p, j, i]))
                    own += a * b
                    size += 0.5 * (a * a + b * b)
                product += own
                square += size
                if size > 0.0:
                    changes[p, j] = JOINT_RATE * (own / size - smooth)
        if square > 0.0:
            changes[p] += PERSON_RATE * product / square * count / now.shape[1]


@njit(cache=True, error_model="numpy")
def learn_levels(people, seen, innovations, lasting, changes):
    """`learn` all but the factors: changes (P,) becomes by what their logarithms change, for all joints."""
    joints = innovations.shape[1]
    for p in range(len(seen)):
        if not seen[p]:
            continue
        before = people.innovations[p]
        count, square, next_sum, late_sum = innovation_sums(innovations[p], before)
        for j in range(joints):
            for i in range(3):
                before[2, j, i], before[1, j, i] = before[1, j, i], before[0, j, i]
                before[0, j, i] = innovations[p, j, i]
        people.counts[p] += 1
        if people.counts[p] <= FIRST or not count:
            continue
        changes[p] = RATE * next_sum / (3.0 * joints) / people.levels[p]
        if people.counts[p] <= SETTLED:
            continue
        share = count / joints
        people.weights[p] = min(people.weights[p] + share, MEMORY)
        people.levels[p] += (square / (3.0 * count) - people.levels[p]) * share / people.weights[p]
        late = late_sum / (3.0 * count) / people.levels[p]
        lasting[0] = min(lasting[0] + share, LASTING_MEMORY)
        lasting[1] += (late - lasting[1]) * share / lasting[0]


@njit(cache=True, error_model="numpy")
def innovation_sums(now, before):
    """Of innovations (J, 3), clipped: number, sum of squares, sums of products over time.

    Args:
        before: (3, J, 3) the last ones. The sums of products are with the last one, and with the two
            before that together.
    """
    count = 0
    square = next_sum = late_sum = 0.0
    for j in range(len(now)):
        if not np.isfinite(now[j, 0]):
            continue
        count += 1
        for i in range(3):
            value = min(CLIP, max(-CLIP, now[j, i]))
            square += value * value
            for k in range(3):
                if np.isfinite(before[k, j, 0]):
                    product = value * min(CLIP, max(-CLIP, before[k, j, i]))
                    if k == 0:
                        next_sum += product
                    else:
                        late_sum += product
    return count, square, next_sum, late_sum


@njit(cache=True, error_model="numpy")
def process_noise(speeds, factors, states, least, growth, noise):
    """Noise (P, J) m^2/s^3, spectral density of acceleration: limbs that swing need more than the trunk.

    Args:
        speeds: (P, J) m/s of late; become at least those of the states (P, J, 6) against the body, which
            moves with their median, but at most `TOP_SPEED`.
        factors: (P, J). least, growth: noise for a factor of 1 is least + growth speed^2.
    """
    joints, body, known = states.shape[1], np.empty(3), np.empty(states.shape[1])
    for p in range(len(states)):
        for i in range(3):
            count = 0
            for j in range(joints):
                if np.isfinite(states[p, j, 3]):
                    known[count] = states[p, j, 3 + i]
                    count += 1
            body[i] = np.median(known[:count]) if count else np.nan
        for j in range(joints):
            if np.isfinite(states[p, j, 3]):
                against = 0.0
                for i in range(3):
                    against += (states[p, j, 3 + i] - body[i]) ** 2
                speeds[p, j] = max(speeds[p, j], min(np.sqrt(against), TOP_SPEED))
            noise[p, j] = factors[p, j] * (least + growth * speeds[p, j] ** 2)
