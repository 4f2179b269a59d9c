"""Tracks of all people, as arrays, and their distances to the skeletons of an instant."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.domain import PoseSet, TrackSet
from panoptic_ros.identity.appearance import ClothingColours
from panoptic_ros.identity.bone_lengths import learn_lengths
from panoptic_ros.identity.likeness import BoneLengths, learnt_bones
from panoptic_ros.identity.motion import JointMotion, predict, update_joints
from panoptic_ros.kernels import njit
from panoptic_ros.solving.limbs import Limbs

Array = np.ndarray

KNOWN_AFTER = 10  # number of measurements of a bone from which its length is treated as known
# Number of measurements over which a bone length is averaged. It is a count and not a duration: bones do
# not change, and the certainty of the mean depends on the number of measurements. The average is limited so
# that errors of the first measurements fade.
LENGTH_MEMORY = 60.0
DRIFT_FADE_TIME = 0.5  # s, time constant with which the velocity of an unseen person decays
BALANCE_TIME = 0.316  # s, time constant of the balance of exchanged and straight views: factor 0.9 per 1/30 s
FLOOR = 0.03  # m, standard deviation of every joint's biases and time offsets, added to its covariance
WORST = 10.0  # standard deviations at which distances of joints are truncated
# Cost of a track or skeleton without a partner. A new person may be anywhere in a room of 40 m^3. Relative to
# a density that falls off as exp(-distance / sigma), that costs ln(40 / (8 pi FLOOR^3)).
ALONE = 11.0


class TrackedBodies(NamedTuple):
    """Bone lengths and body motion of T people.

    Args:
        lengths: (T, B) m, mean bone lengths, NaN = unknown.
        counts: (T, B) number of measurements of each length.
        squares: (T, B) m^2, mean squared deviation of single measurements from the mean.
        middles: (T, 3) m, world, centres of the bodies.
        drifts: (T, 3) m/s, velocities of the centres.
    """

    lengths: Array
    counts: Array
    squares: Array
    middles: Array
    drifts: Array


class Tracks(NamedTuple):
    """T people over time.

    Args:
        ids: (T,) identities, -1 = not confirmed yet.
        motion: Filters of the joints.
        bodies: Bone lengths and body motion.
        clothes: Colours of the clothes.
        heads: (T, 3) m, world, last measured position of the head, NaN = none.
        unseen: (T,) s since the person was last seen.
        missed: (T,) s, the part of `unseen` in which sets arrived.
        hits: (T,) number of instants in which the person was seen.
        seconds: (T,) s since the track began.
        balance: (T, G) views that see each limb exchanged minus views that see it straight, with exponential
            forgetting.
    """

    ids: Array
    motion: JointMotion
    bodies: TrackedBodies
    clothes: ClothingColours
    heads: Array
    unseen: Array
    missed: Array
    hits: Array
    seconds: Array
    balance: Array

    @classmethod
    def of_new(cls, people: int, joints: int, bones: int, limbs: int) -> Tracks:
        """Return the tracks of people before their first measurement."""
        numbers, unknown = np.zeros((4, people, bones)), np.full((2, people, 3), np.nan)
        return cls(
            np.full(people, -1),
            JointMotion.of_new(people, joints),
            TrackedBodies(numbers[0] * np.nan, numbers[1], numbers[2], unknown[0], np.zeros((people, 3))),
            ClothingColours.of_new(people),
            unknown[1],
            np.zeros(people),
            np.zeros(people),
            np.zeros(people, np.int64),
            np.zeros(people),
            np.zeros((people, limbs)),
        )

    @property
    def bones(self) -> BoneLengths:
        """Return the learnt bone lengths with their variances."""
        return learnt_bones(*self.bodies[:3])

    def predict(self, dt: float, blind: bool = False) -> None:
        """Predict the tracks by dt s, in place.

        Args:
            blind: whether capture paused meanwhile, so that the time is not treated as missed.
        """
        predict(self.motion, dt)
        self.unseen[:] += dt
        self.seconds[:] += dt
        self.missed[:] += 0.0 if blind else dt
        # upper limit of the distance at a decaying velocity
        self.bodies.middles[:] += min(dt, DRIFT_FADE_TIME) * self.bodies.drifts
        self.bodies.drifts[:] *= np.exp(-dt / DRIFT_FADE_TIME)

    def take_over(self, lost: int, fresh: int) -> None:
        """Merge bone lengths and clothes of a lost track into a new track of the same person, in place.

        Args:
            lost, fresh: rows of the two tracks.
        """
        lengths, measured, squares = self.bodies[:3]
        counts = measured[lost] + measured[fresh]
        both = sum(np.nan_to_num(lengths[row]) * measured[row] for row in (lost, fresh))
        lengths[fresh] = np.where(counts > 0.0, both / np.maximum(counts, 1.0), np.nan)
        squares[fresh] = squares[lost] * measured[lost] + squares[fresh] * measured[fresh]
        squares[fresh] /= np.maximum(counts, 1.0)
        measured[fresh] = np.minimum(counts, LENGTH_MEMORY)
        self.clothes.take_over(lost, fresh)

    def update(self, owners: Array, poses: PoseSet, bones: Array, head: int) -> None:
        """Update the tracks with skeletons, in place.

        Args:
            owners: (P,) row of the track of each skeleton, -1 = none.
            bones: (B, 2) joints at the ends of the bones.
            head: joint of the head.
        """
        update_tracks(
            self.motion,
            self.bodies,
            owners,
            poses.positions,
            poses.covariances,
            poses.views,
            poses.states,
            bones,
        )
        k = np.flatnonzero(owners >= 0)
        memory = np.exp(-self.unseen[owners[k]] / BALANCE_TIME)[:, None]
        self.unseen[owners[k]] = self.missed[owners[k]] = 0.0
        self.hits[owners[k]] += 1
        seen = k[np.isfinite(poses.positions[k, head, 0])]
        self.heads[owners[seen]] = poses.positions[seen, head]
        if poses.side_votes is not None:
            self.balance[owners[k]] = memory * self.balance[owners[k]] + poses.side_votes[k]

    def exchange_sides(self, limbs: Limbs) -> None:
        """Exchange left and right of limbs with a positive balance, in place.

        Most recent views see these limbs exchanged.
        """
        wrong = self.balance > 0.0
        if not wrong.any():
            return
        joints, rows = np.arange(len(limbs.mirror)), np.arange(len(wrong))[:, None]
        touched = wrong[:, np.maximum(limbs.groups, 0)] & (limbs.groups >= 0)
        take = np.where(touched, limbs.mirror, joints)
        for table in self.motion:
            table[:] = table[rows, take]
        self.balance[wrong] *= -1.0

    def record(self, poses: PoseSet) -> TrackSet:
        """Return the record that is fed back to association."""
        return TrackSet(
            poses.index,
            poses.stamp_ns,
            poses.skeleton_hash,
            self.ids,
            unseen=self.unseen,
            **self.motion._asdict(),
            lengths=np.where(self.bodies.counts >= KNOWN_AFTER, self.bodies.lengths, np.nan),
        )


@njit(cache=True, error_model="numpy")
def update_tracks(motion, bodies, owners, positions, covariances, views, states, bones):
    """Update filters, bone lengths and centres of the tracks with skeletons, in place; see `Tracks.update`.

    Args:
        bones: (B, 2) joints at the ends of the bones.
    """
    joints = positions.shape[1]
    places, speeds = np.empty(joints), np.empty(joints)
    for k in range(len(owners)):
        t = owners[k]
        if t < 0:
            continue
        update_joints(motion, t, positions[k], covariances[k], views[k], states[k])
        learn_lengths(
            positions[k],
            covariances[k],
            states[k],
            bones,
            LENGTH_MEMORY,
            bodies.lengths[t],
            bodies.counts[t],
            bodies.squares[t],
        )
        for axis in range(3):
            count = 0
            for j in range(joints):
                if np.isfinite(positions[k, j, 0]):
                    places[count], speeds[count] = positions[k, j, axis], motion.states[t, j, 3 + axis]
                    count += 1
            if count:
                bodies.middles[t, axis] = np.median(places[:count])
                bodies.drifts[t, axis] = np.median(speeds[:count])


@njit(cache=True, error_model="numpy")
def _distance(a, b):
    return np.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)


@njit(cache=True, error_model="numpy")
def joint_distances(states, variances, positions, covariances):
    """Return the mean distances (T, P) m of predicted and measured joints, and assignment costs (T, P).

    Both are means over the common joints, infinite if there are none. The distance is compared with a gate.
    The cost is the negative logarithm, up to a constant, of a density that falls off with the truncated
    Mahalanobis distance. The cost grows with the uncertainty of the prediction. A person who was not seen for
    a while may be anywhere, and is less likely to be here.

    Args:
        states: (T, J, 6) of the tracks, see `JointMotion`.
        variances: (T, J, 3) of the tracks, see `JointMotion`.
        positions: (P, J, 3) m, world, of the skeletons.
        covariances: (P, J, 3, 3) m^2 of the skeletons.
    """
    distance = np.full((len(states), len(positions)), np.inf)
    cost = np.full(distance.shape, np.inf)
    for t in range(len(states)):
        for p in range(len(positions)):
            gaps = scaled = 0.0
            count = 0
            for j in range(positions.shape[1]):
                gap = _distance(states[t, j], positions[p, j])
                if np.isfinite(gap):
                    c, extra = covariances[p, j], variances[t, j, 0] + FLOOR**2
                    x = positions[p, j, 0] - states[t, j, 0]
                    y = positions[p, j, 1] - states[t, j, 1]
                    z = positions[p, j, 2] - states[t, j, 2]
                    xx = np.sqrt(c[0, 0] + extra)  # Cholesky factor of the difference's covariance
                    yx, zx = c[1, 0] / xx, c[2, 0] / xx
                    yy = np.sqrt(c[1, 1] + extra - yx**2)
                    zy = (c[2, 1] - zx * yx) / yy
                    zz = np.sqrt(c[2, 2] + extra - zx**2 - zy**2)
                    x /= xx
                    y = (y - yx * x) / yy
                    z = (z - zx * x - zy * y) / zz
                    count += 1
                    gaps += gap
                    scaled += min(np.sqrt(x * x + y * y + z * z), WORST) + np.log(xx * yy * zz / FLOOR**3)
            if count:
                distance[t, p], cost[t, p] = gaps / count, scaled / count
    return distance, cost


def head_distances(heads: Array, positions: Array, head: int) -> Array:
    """Return the distances (T, P) m from the last heads of tracks to the heads of skeletons.

    They are infinite where a head is unknown.

    Args:
        heads: (T, 3) m, last positions of the heads of tracks.
        positions: (P, J, 3) m, world, of the skeletons.
        head: joint of the head.
    """
    distances = np.linalg.norm(heads[:, None] - positions[None, :, head], axis=-1)
    return np.where(np.isfinite(distances), distances, np.inf)
