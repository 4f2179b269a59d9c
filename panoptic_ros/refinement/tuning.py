"""Process noise and the scale of covariances, learnt online from the innovations of the filter.

If the model of a filter is right, its whitened innovations have variance 1 and no correlation over time
(Mehra 1970). If successive innovations point the same way, the filter follows too slowly and needs more
process noise. If they alternate, it follows noise and needs less. This test does not depend on the scale of
the noise. With the right process noise, the mean squared innovation is the scale of all covariances.

Detector errors that persist for some frames look like motion. The filter follows such an error and then
returns, so innovations two and three frames apart have opposite signs. Smoothed joints are then less certain.
The corresponding growth of the covariances was found approximately, by simulation of such errors.
"""

from __future__ import annotations

import numpy as np

from panoptic_ros.kernels import njit
from panoptic_ros.refinement.records import PeopleStatistics

Array = np.ndarray

TOP_SPEED = 3.0  # m/s relative to the body, upper limit of a joint's speed: higher values are noise
CLIP = 3.0  # standard deviations at which innovations are clipped
FIRST = 4  # measurements of a person before process noise is learnt from positions
SETTLED = 10  # measurements before the scale is learnt: earlier innovations depend on the velocity prior
# change of the log process noise per measurement and unit of correlation, for innovations of positions
RATE = 0.2
# change of the log process noise as RATE, for innovations of displacements: of one joint, and of all joints
# of the person
JOINT_RATE, PERSON_RATE = 0.05, 0.1
# correlation of successive displacement innovations at which the process noise is right; s, interval between
# these innovations
SMOOTH, SMOOTH_AFTER = 0.35, 0.04
RANGE = (0.1, 10.0)  # limits of the factor on the process noise
MEMORY = 100.0  # measurements of a whole person, memory of the scale of covariances
# prior weight and memory of the correlation of persistent errors, in measurements of whole persons
LASTING_PRIOR, LASTING_MEMORY = 60.0, 1000.0
LASTING_FREE = 0.06  # negative correlation, two and three frames apart, up to which errors do not persist
LASTING_GAIN = 8.0  # growth of covariances per unit of correlation beyond LASTING_FREE


def nothing_lasting() -> Array:
    """Return the initial weight and correlation of persistent errors; they belong to the detector."""
    return np.array([LASTING_PRIOR, 0.0])


def scales(people: PeopleStatistics, lasting: Array) -> Array:
    """Return the factors (P,) on the covariances of filter and smoother."""
    scaled: Array = people.levels * (1.0 + LASTING_GAIN * max(0.0, -float(lasting[1]) - LASTING_FREE))
    return scaled


def learn(people: PeopleStatistics, seen: Array, innovations: Array, lasting: Array) -> None:
    """Update the learnt values in `people` and `lasting` from the whitened innovations of positions.

    If displacements of a joint were measured on the surface, `learn_turns` learns its process noise instead.

    Args:
        seen: (P,) whether the person is in the set.
        innovations: (P, J, 3), NaN = not measured.
        lasting: (2,) weight and correlation of persistent errors, updated.
    """
    changes = np.zeros(len(seen))
    learn_levels(people, seen, innovations, lasting, changes)
    _change(people, np.where(np.isfinite(people.turns[..., 0]), 0.0, changes[:, None]))


def learn_turns(people: PeopleStatistics, innovations: Array, dt: float) -> None:
    """Update the process noise in `people` from the whitened innovations of displacements.

    Innovations of displacements show the process noise more clearly than innovations of positions. Detector
    errors persist, so innovations of positions point the same way for any process noise. Displacements have
    no such errors. They are also accurate enough for single joints: an arm swings while the legs stand.

    People move more smoothly than with random accelerations. So the innovations of a swinging joint point the
    same way for long, and their correlation is higher for shorter intervals between images. `SMOOTH` is the
    correlation at which the process noise is right. A joint with less correlation needs less noise than the
    rest of the person.

    Args:
        innovations: (P, J, 3), NaN = not measured.
        dt: s, duration of the displacements.
    """
    changes = np.zeros(innovations.shape[:2])
    turn_correlations(people.turns, innovations, SMOOTH ** (dt / SMOOTH_AFTER), changes)
    _change(people, changes)
    people.turns[:] = innovations


def _change(people: PeopleStatistics, changes: Array) -> None:
    """Add changes (P, J) to the logarithms of the factors on the process noise in `people`."""
    people.factors[:] = np.minimum(np.maximum(people.factors * np.exp(changes), RANGE[0]), RANGE[1])


@njit(cache=True, error_model="numpy")
def turn_correlations(before, now, smooth, changes):
    """Write the changes (P, J) of the logarithms of the factors, from two successive innovations.

    Joints that were not measured twice change only with the person.

    Args:
        before, now: (P, J, 3) whitened innovations, NaN = not measured.
        smooth: Correlation at which the noise of a joint is right.
        changes: (P, J), output.
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
    """Update all learnt values in `people` except the factors, and those in `lasting`.

    Args:
        changes: (P,), output: changes of the logarithms of the factors of all joints of a person.
    """
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
    """Return the number of innovations, their sum of squares, and their sums of products over time.

    All innovations are clipped at `CLIP`.

    Args:
        now: (J, 3) innovations, NaN = not measured.
        before: (3, J, 3) innovations one, two and three measurements ago, NaN = not measured.

    Returns:
        count: Number of measured joints.
        square: Sum of squares.
        next_sum: Sum of products with the innovations one measurement ago.
        late_sum: Sum of products with the innovations two and three measurements ago.
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
    """Write the process noise (P, J) m^2/s^3 to `noise`; limbs that swing have more than the trunk.

    Args:
        speeds: (P, J) m/s, largest recent speeds; raised to the present speeds relative to the body, at
            most `TOP_SPEED`. The velocity of the body is the median over its joints.
        factors: (P, J) factors on the process noise.
        states: (P, J, S).
        least: m^2/s^3, process noise at rest for a factor of 1.
        growth: 1/s, growth of this noise with the squared speed.
        noise: (P, J) m^2/s^3, spectral density of the acceleration, output.
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
