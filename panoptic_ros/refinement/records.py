"""What refinement keeps of P people of J joints; people are the first axis of every array."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.domain.of_all import of_all
from panoptic_ros.refinement.motion_model import MOVING
from panoptic_ros.refinement.trust import BEGUN

Array = np.ndarray

PRIOR = 8.0  # weight of a new person's level, in measurements


class Motion(NamedTuple):
    """Positions and velocities of joints."""

    states: Array  # (P, J, S) m, m/s and by some models m/s^2, NaN = unknown
    covariances: Array  # (P, J, S, S)


class Measured(NamedTuple):
    """What was measured until an instant."""

    people: Array  # (P,) bool, who is in the instant's set
    joints: Array  # (P, J) bool, which are measured
    views: Array  # (P, J) of these measurements
    scores: Array  # (P, J) of the latest measurements, 0 before any
    noises: Array  # (P, J, 3, 3) m^2, of those
    points: Array  # (P, J, 3) m of this instant, NaN = none
    ages: Array  # (P, J) s since those
    carried: Array  # (P, J) bool, at each instant since those the surface showed how the joint moved
    person_scores: Array  # (P,) of those
    filled: Array  # (P, J) bool, whether the latest rest on a prediction and the rest of the body too
    trust: Array  # (P, J) s, for how much longer measurements have agreed with a joint's motion than not
    lasting: Array  # (P, J, 3, 3) m^2, of those that are not filled what smoothing leaves, of late


class Moment(NamedTuple):
    """All people at one instant."""

    stamp_ns: int
    dt: float  # s since the moment before
    noise: Array  # (P, J) m^2/s^3, process noise since then
    predicted: Motion  # from the moment before
    gains: Array  # (P, J, S, S) of the smoother back to that moment, transposed
    motion: Motion  # with this instant's measurements
    measured: Measured
    linked: Array  # (P, J) bool, whose motion since the moment before was measured on the surface


class People(NamedTuple):
    """Who is there, in the order in which they came, and what is learnt of them."""

    ids: Array  # (P,)
    speeds: Array  # (P, J) m/s against the body, the largest of late
    factors: Array  # (P, J) on the process noise
    levels: Array  # (P,) of the covariances
    weights: Array  # (P,) of the levels, in measurements of a person
    counts: Array  # (P,) measurements of a person
    innovations: Array  # (P, 3, J, 3) whitened, of one, two, three measurements ago; NaN = none
    turns: Array  # (P, J, 3) whitened innovations of displacements, of the instant before; NaN = none
    found: Array  # (P, J, 6) m and m/s, motion of the moment that was shown last; NaN = none
    left: Array  # (P, J, 6) m and m/s, by which what was shown of it differed
    pulled: Array  # (P, J, 3) m, by which bones moved these for errors that last; NaN = not known
    followed: Array  # (P, J, 3) m, how joints moved against the torso of late, by the surface
    seen: Array  # (P, J, 3) m, the same by views
    lengths: Array  # (P, B) m, means of bones
    frames: Array  # (P, B) of which they are
    squares: Array  # (P, B) m^2, mean squares of the differences from these means


def unknown(stamp_ns: int, dt: float, people: int, joints: int, size: int = MOVING) -> Moment:
    """A moment of people of whom nothing is known; size: S of their motion."""
    shape = (people, joints)
    nothing = Motion(np.full((*shape, size), np.nan), np.zeros((*shape, size, size)))
    predicted, motion = (of_all(np.copy, nothing) for _ in range(2))
    measured = Measured(
        np.zeros(people, bool),
        np.zeros(shape, bool),
        np.zeros(shape, np.int32),
        np.zeros(shape),
        np.zeros((*shape, 3, 3)),
        np.full((*shape, 3), np.nan),
        np.zeros(shape),
        np.zeros(shape, bool),
        np.zeros(people),
        np.zeros(shape, bool),
        np.full(shape, BEGUN),
        np.zeros((*shape, 3, 3)),
    )
    noise, gains = np.zeros(shape), np.zeros((*shape, size, size))
    return Moment(stamp_ns, dt, noise, predicted, gains, motion, measured, np.zeros(shape, bool))


def padded(motion: Motion, size: int) -> Motion:
    """With states of another size; what they have more of is 0, and known to be."""
    more = [(0, size - motion.states.shape[-1])]
    whole = [(0, 0)] * (motion.states.ndim - 1)
    return Motion(np.pad(motion.states, whole + more), np.pad(motion.covariances, whole + more + more))


def widened(moment: Moment, size: int) -> Moment:
    """The same moment with states of another size."""
    more = [(0, 0), (0, 0), *[(0, size - moment.gains.shape[-1])] * 2]
    motion, predicted = padded(moment.motion, size), padded(moment.predicted, size)
    return moment._replace(motion=motion, predicted=predicted, gains=np.pad(moment.gains, more))


def new_people(ids: list[int], joints: int, bones: int) -> People:
    """People who have just come."""
    count = len(ids)
    return People(
        np.array(ids, np.int64),
        np.zeros((count, joints)),
        np.ones((count, joints)),
        np.ones(count),
        np.full(count, PRIOR),
        np.zeros(count, np.int64),
        np.full((count, 3, joints, 3), np.nan),
        np.full((count, joints, 3), np.nan),
        np.full((count, joints, MOVING), np.nan),
        np.zeros((count, joints, MOVING)),
        np.full((count, joints, 3), np.nan),
        np.zeros((count, joints, 3)),
        np.zeros((count, joints, 3)),
        *np.zeros((3, count, bones)),
    )
