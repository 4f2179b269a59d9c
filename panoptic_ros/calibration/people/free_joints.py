"""Free joints: each joint of a person at one instant is a target of one point of the bundle adjustment."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.calibration.bundle import Adjustment, CameraStates, Observations, adjust, residuals_of
from panoptic_ros.calibration.free_points import kept_points, points_at, points_seen
from panoptic_ros.calibration.people.sightings import JointSightings
from panoptic_ros.calibration.projection import POSE
from panoptic_ros.geometry import ProjectionStack, triangulate_robust

Array = np.ndarray
MOST_POINTS = 6000  # free joints of an adjustment; more change errors by little and cost time
START_PX = 10.0  # px, noise with which points are started, and gates them
SCALE = 2.0  # scale of the Cauchy weights, in standard deviations
MEDIAN_SQUARE = 2.0 * np.log(2.0)  # median of a chi-squared variable with two degrees of freedom
LEAST_SHARE = 0.1  # redundancy below which a residual is too small to tell the noise
NEAREST_M = 0.1  # m, depth
STEPS = 8  # steps of a round before the last
LEAST_NOISE_PX = 0.05  # px
SCORE_BINS = 6  # groups of equal size by score, with a noise of their own
FEWEST_IN_GROUP = 60  # residuals that determine the noise of a group


class FreeJoints(NamedTuple):
    """Free joints and what cameras see of them.

    Args:
        seen: Observations of the adjustment.
        speeds: (M, 2) s^-1, velocity on the normalised plane. scores: (M,).
        people, instants, joints: (B,) person, index of the instant and joint of each point.
    """

    seen: Observations
    speeds: Array
    scores: Array
    people: Array
    instants: Array
    joints: Array


class Sides(NamedTuple):
    """Joint of the other side (J,), and limb (J,) of each used joint: arms 0, legs 1, none -1."""

    mirror: Array
    limb: Array


def free_joints(
    sightings: JointSightings, people: Array, cameras: CameraStates
) -> tuple[FreeJoints, Adjustment]:
    """Return the joints of all people that two cameras see, with their triangulated positions.

    Args:
        people: (N,) person of each tracklet, -1 = none.
    """
    plane, source = _by_person(sightings, people, len(cameras))
    views = np.isfinite(plane).all(axis=-1).sum(axis=-1)
    who, when, joint = _thinned(views >= 2)
    stack = ProjectionStack(cameras.rotations, cameras.translations, cameras.lenses[:, :2].mean(axis=1))
    own = plane[who, when, joint]
    found = triangulate_robust(stack, own, np.full(own.shape[:2], START_PX))
    good = np.isfinite(found.points).all(axis=1)
    who, when, joint, points = who[good], when[good], joint[good], found.points[good]
    given = np.isfinite(plane[who, when, joint]).all(axis=-1)
    target, camera = np.nonzero(given)
    tracklet = source[who[target], when[target], camera]
    at = (tracklet, when[target], joint[target])
    seen = points_seen(camera, target, sightings.points[at], START_PX**2)
    seen = seen._replace(delays=sightings.late[tracklet, when[target]])
    state = Adjustment(cameras, points_at(points), np.zeros(len(target)))
    joints = FreeJoints(seen, sightings.plane_speeds[at], sightings.scores[at], who, when, joint)
    return with_velocities(joints, state), state


def _thinned(known: Array) -> tuple[Array, Array, Array]:
    """Return person, instant and joint of at most `MOST_POINTS` of known joints (P, K, J), sorted by instant.

    Whole bodies are chosen, evenly over time.
    """
    when, who = np.nonzero(known.any(axis=2).T)
    count = int(known.sum())
    most = max(1, int(len(when) * min(1.0, MOST_POINTS / max(count, 1))))
    chosen = np.unique(np.linspace(0, len(when) - 1, most).astype(int))
    body, joint = np.nonzero(known[who[chosen], when[chosen]])
    return who[chosen][body], when[chosen][body], joint


def _by_person(sightings: JointSightings, people: Array, cameras: int) -> tuple[Array, Array]:
    """Return normalised points (P, K, J, C, 2) by person, NaN = not seen, and their tracklets (P, K, C)."""
    instants, joints = sightings.plane.shape[1:3]
    plane = np.full((int(people.max()) + 1, instants, joints, cameras, 2), np.nan)
    source = np.full((len(plane), instants, cameras), -1)
    for n in np.flatnonzero(people >= 0):
        p, c = people[n], sightings.cameras[n]
        when = np.flatnonzero(sightings.seen[n])
        plane[p, when, :, c] = sightings.plane[n, when]
        source[p, when, c] = n
    return plane, source


def with_velocities(joints: FreeJoints, state: Adjustment) -> FreeJoints:
    """Return the joints with the motion of each point that fits the image velocities of its views best.

    Views count by their weight in the adjustment. Image velocities of guessed joints are noise, which draws
    clock offsets to 0.
    """
    seen = joints.seen
    slopes, weights = _slopes(seen, state), _weights(seen, state)
    speeds = joints.speeds * state.cameras.lenses[seen.cameras, :2]
    information = _by_point(seen, weights[:, None, None] * np.einsum("mki,mkj->mij", slopes, slopes))
    pulls = weights[:, None] * np.einsum("mki,mk->mi", slopes, speeds)
    pull = np.add.reduceat(pulls, seen.firsts[:-1], axis=0)
    twists = np.zeros((len(information), POSE))
    twists[:, 3:] = np.linalg.solve(information, pull[..., None])[..., 0]
    return joints._replace(seen=seen._replace(twists=twists))


def _slopes(seen: Observations, state: Adjustment) -> Array:
    """Return the derivatives (M, 2, 3) px/m of undistorted pixels by the points."""
    cameras = state.cameras
    turn = cameras.rotations[seen.cameras]
    local = np.einsum("mij,mj->mi", turn, state.targets.translations[seen.targets])
    local += cameras.translations[seen.cameras]
    depth = np.maximum(local[:, 2], NEAREST_M)[:, None, None]
    slopes = (turn[:, :2] - local[:, :2, None] * turn[:, 2:] / depth) / depth
    scaled: Array = slopes * cameras.lenses[seen.cameras, :2, None]
    return scaled


def _weights(seen: Observations, state: Adjustment) -> Array:
    """Return the weights (M,) px^-2 of observations in the adjustment."""
    misses = (residuals_of(seen, state) ** 2).sum(axis=1) / seen.variances
    weights: Array = 1.0 / (seen.variances * (1.0 + misses / SCALE**2))
    return weights


def _by_point(seen: Observations, own: Array) -> Array:
    """Return the information (B, 3, 3) of each point, the sum of those (M, 3, 3) of its views."""
    information: Array = np.add.reduceat(own, seen.firsts[:-1], axis=0)
    information += 1e-9 * np.trace(information, axis1=1, axis2=2)[:, None, None] * np.eye(3)
    return information


def with_noise(joints: FreeJoints, state: Adjustment) -> FreeJoints:
    """Return the joints with variances from their residuals: product of camera, joint, and score.

    Each factor is the median of the squared residuals of a group over the product of the other factors.
    """
    seen = joints.seen
    squares = (residuals_of(seen, state) ** 2).sum(axis=1) / MEDIAN_SQUARE / redundancies(seen, state)
    edges = np.quantile(joints.scores, np.linspace(0.0, 1.0, SCORE_BINS + 1)[1:-1])
    groups = (seen.cameras, joints.joints[seen.targets], np.searchsorted(edges, joints.scores))
    variances = np.full(len(squares), max(float(np.median(squares)), LEAST_NOISE_PX**2))
    for group in groups:
        variances = variances * _factors(squares / variances, group)[group]
    return joints._replace(seen=seen._replace(variances=np.maximum(variances, LEAST_NOISE_PX**2)))


def redundancies(seen: Observations, state: Adjustment) -> Array:
    """Return the share (M,) of the noise of each observation that its residual shows.

    The point follows the rest. Without it, a camera of small noise draws all points to its rays, and its
    noise seems to be 0.
    """
    slopes = _slopes(seen, state)
    own = _weights(seen, state)[:, None, None] * np.einsum("mki,mkj->mij", slopes, slopes)
    information = _by_point(seen, own)
    leverage = 0.5 * np.einsum("mij,mji->m", own, np.linalg.inv(information)[seen.targets])
    shares: Array = np.clip(1.0 - leverage, LEAST_SHARE, 1.0)
    return shares


def _factors(squares: Array, group: Array) -> Array:
    """Return the median of the squares (M,) of each group (M,), 1 in small groups."""
    factors = np.ones(int(group.max()) + 1)
    for k in range(len(factors)):
        own = squares[group == k]
        if len(own) >= FEWEST_IN_GROUP:
            factors[k] = max(float(np.median(own)), 1e-3)
    return factors


def repetition(joints: FreeJoints, state: Adjustment) -> float:
    """Return the factor of the variances that accounts for persistent noise (Moulton 1986, design effect).

    Residuals of one joint of one person in one camera are summed. The sum of independent ones grows with the
    root of time, that of a constant bias of the detector with time.
    """
    seen = joints.seen
    scale = np.sqrt(seen.variances * redundancies(seen, state))
    normal = residuals_of(seen, state) / scale[:, None]
    person, joint = joints.people[seen.targets], joints.joints[seen.targets]
    group = np.unique(np.stack([seen.cameras, person, joint]), axis=1, return_inverse=True)[1].reshape(-1)
    sums = np.stack([np.bincount(group, weights=normal[:, k]) for k in range(2)])
    return float((sums**2).sum() / (2.0 * len(normal)))


def adjusted(
    joints: FreeJoints, state: Adjustment, rounds: int, sides: Sides
) -> tuple[FreeJoints, Adjustment]:
    """Return the joints with their noise and motion, and the adjusted state, after rounds of both.

    Limbs that a view shows exchanged, left for right, are left out. Legs are apart along the walk, so
    exchanged ones look like a clock offset.
    """
    for _ in range(rounds):
        state = adjust(joints.seen, state, SCALE, STEPS)
        joints = with_noise(with_velocities(joints, state), state)
        joints, state = kept_joints(joints, state, ~exchanged(joints, state, sides))
    return joints, adjust(joints.seen, state, SCALE)


def exchanged(joints: FreeJoints, state: Adjustment, sides: Sides) -> Array:
    """Return which observations (M,) are of a limb that its view shows on the other side."""
    seen = joints.seen
    shape = (int(joints.people.max()) + 1, int(joints.instants.max()) + 1, len(sides.mirror))
    table = np.full(shape, -1)
    table[joints.people, joints.instants, joints.joints] = np.arange(len(joints.people))
    person, instant, joint = (row[seen.targets] for row in (joints.people, joints.instants, joints.joints))
    other = table[person, instant, sides.mirror[joint]]
    limb = np.where(other >= 0, sides.limb[joint], -1)
    mirrored = residuals_of(seen._replace(targets=np.where(other >= 0, other, seen.targets)), state)
    losses = [
        np.log1p((misses**2).sum(axis=1) / seen.variances / SCALE**2)
        for misses in (residuals_of(seen, state), mirrored)
    ]
    limbs = int(sides.limb.max()) + 1
    key = ((seen.cameras * shape[0] + person) * shape[1] + instant) * limbs + limb
    group = np.unique(np.where(limb >= 0, key, -1), return_inverse=True)[1].reshape(-1)
    own, their = (np.bincount(group, weights=loss) for loss in losses)
    found: Array = (limb >= 0) & (their < own)[group]
    return found


def kept_joints(joints: FreeJoints, state: Adjustment, good: Array) -> tuple[FreeJoints, Adjustment]:
    """Return the joints with the good observations (M,) of points that two cameras still see."""
    kept, state, good, used = kept_points(joints.seen, state, good)
    found = FreeJoints(
        kept,
        joints.speeds[good],
        joints.scores[good],
        joints.people[used],
        joints.instants[used],
        joints.joints[used],
    )
    return found, state
