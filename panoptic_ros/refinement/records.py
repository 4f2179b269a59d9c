"""State of refinement for P people with J joints; people are the first axis of every array."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.domain.of_all import of_all
from panoptic_ros.refinement.motion_model import MOVING
from panoptic_ros.refinement.trust import BEGUN

Array = np.ndarray

PRIOR = 8.0  # weight of the initial level of a new person, in measurements


class MotionStates(NamedTuple):
    """States of joints, and their covariances."""

    states: Array  # (P, J, S) m, m/s and in one model m/s^2, NaN = unknown
    covariances: Array  # (P, J, S, S)


class JointMeasurements(NamedTuple):
    """Measurements up to an instant."""

    people: Array  # (P,) bool, whether the set of this instant contains the person
    joints: Array  # (P, J) bool, whether measured at this instant
    views: Array  # (P, J) number of views behind these measurements
    scores: Array  # (P, J) of the latest measurement, 0 = none yet
    noises: Array  # (P, J, 3, 3) m^2, covariance of the latest measurement
    points: Array  # (P, J, 3) m, measured at this instant, NaN = none
    ages: Array  # (P, J) s since the latest measurement
    carried: Array  # (P, J) bool, whether the surface showed all motion since the latest measurement
    person_scores: Array  # (P,) of the latest set with the person
    filled: Array  # (P, J) bool, whether the latest also depends on a prediction and on other joints
    trust: Array  # (P, J) s, time that measurements agreed with the motion minus time that they disagreed
    lasting: Array  # (P, J, 3, 3) m^2, recent covariance of persistent errors; filled joints are ignored


class FilterState(NamedTuple):
    """State of all people at one instant."""

    stamp_ns: int
    dt: float  # s since the previous moment
    noise: Array  # (P, J) m^2/s^3, process noise since the previous moment
    predicted: MotionStates  # from the previous moment
    gains: Array  # (P, J, S, S) of the smoother back to the previous moment, transposed
    motion: MotionStates  # filtered: with the measurements of this instant
    measured: JointMeasurements
    linked: Array  # (P, J) bool, whether the surface showed the displacement since the previous moment


class PeopleStatistics(NamedTuple):
    """People in the order of their arrival, with the values that are learnt for them."""

    ids: Array  # (P,)
    speeds: Array  # (P, J) m/s relative to the body, largest recent speed
    factors: Array  # (P, J) factors on the process noise
    levels: Array  # (P,) scale of the covariances
    weights: Array  # (P,) number of measurements of a whole person that the level averages, at most 100
    counts: Array  # (P,) number of measurements of the person
    innovations: Array  # (P, 3, J, 3) whitened, one, two and three measurements ago; NaN = none
    turns: Array  # (P, J, 3) whitened innovations of the latest displacements; NaN = none
    found: Array  # (P, J, 6) m and m/s, estimate for the latest output; NaN = none
    left: Array  # (P, J, 6) m and m/s, latest output minus that estimate
    pulled: Array  # (P, J, 3) m, bone correction of persistent errors in the latest output; NaN = unknown
    followed: Array  # (P, J, 3) m, recent displacement relative to the torso, from the surface
    seen: Array  # (P, J, 3) m, recent displacement relative to the torso, from views
    lengths: Array  # (P, B) m, mean bone lengths
    frames: Array  # (P, B) number of frames in these means
    squares: Array  # (P, B) m^2, mean squared deviations of single lengths from these means


def unknown(stamp_ns: int, dt: float, people: int, joints: int, size: int = MOVING) -> FilterState:
    """Return a moment of people with unknown states of length `size`."""
    shape = (people, joints)
    nothing = MotionStates(np.full((*shape, size), np.nan), np.zeros((*shape, size, size)))
    predicted, motion = (of_all(np.copy, nothing) for _ in range(2))
    measured = JointMeasurements(
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
    return FilterState(stamp_ns, dt, noise, predicted, gains, motion, measured, np.zeros(shape, bool))


def started(points: Array, noises: Array, delays: Array, speed: float) -> MotionStates:
    """Return the states (J, 6) and covariances (J, 6, 6) of J new joints at rest, from points = X + G V.

    Args:
        points: (J, 3) m.
        noises: (J, 3, 3) m^2, covariances of the points.
        delays: (J, 3, 3) s, G.
        speed: Standard deviation of the velocity V, m/s per axis, independent of the noise of the points.
    """
    states, covariances = np.zeros((len(points), 6)), np.empty((len(points), 6, 6))
    states[:, :3] = points
    turned = speed**2 * delays
    covariances[:, :3, :3] = noises + turned @ np.swapaxes(delays, 1, 2)
    covariances[:, :3, 3:], covariances[:, 3:, :3] = -turned, -np.swapaxes(turned, 1, 2)
    covariances[:, 3:, 3:] = speed**2 * np.eye(3)
    return MotionStates(states, covariances)


def padded(motion: MotionStates, size: int) -> MotionStates:
    """Return the motion with longer states; added elements are 0 with covariance 0."""
    more = [(0, size - motion.states.shape[-1])]
    whole = [(0, 0)] * (motion.states.ndim - 1)
    return MotionStates(np.pad(motion.states, whole + more), np.pad(motion.covariances, whole + more + more))


def widened(moment: FilterState, size: int) -> FilterState:
    """Return the moment with longer states."""
    more = [(0, 0), (0, 0), *[(0, size - moment.gains.shape[-1])] * 2]
    motion, predicted = padded(moment.motion, size), padded(moment.predicted, size)
    return moment._replace(motion=motion, predicted=predicted, gains=np.pad(moment.gains, more))


def new_people(ids: list[int], joints: int, bones: int) -> PeopleStatistics:
    """Return the record of people who have just arrived."""
    count = len(ids)
    return PeopleStatistics(
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
