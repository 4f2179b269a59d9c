"""Tracks: constant-velocity filters of people with identity."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from panoptic_ros.domain import PoseSet
from panoptic_ros.geometry.motion import predict_motion, update_motion

Array = np.ndarray

START_SPEED = 1.5  # m/s, standard deviation of the velocity of a new joint
LENGTH_MEMORY = 60.0  # frames over which bone lengths are averaged
FADE_TIME = 0.5  # s, time constant with which the velocity of an unseen person decays


@dataclass(slots=True, eq=False)
class Track:
    """One person over time.

    Args:
        number: the identity, -1 = not confirmed yet.
        states (J, 6), variances (J, 3): see `geometry.motion`; NaN = unknown.
        ages: (J,) s since each joint was measured.
        lengths: (B,) m, mean bone lengths, NaN = unknown. counts: (B,) number of measurements of each.
        middle, drift: (3,) m and m/s, the middle of the body and its velocity.
        head: (3,) m, where the head was seen last, NaN = nowhere.
        unseen: s since the person was seen. hits: how often it was seen.
    """

    number: int
    states: Array
    variances: Array
    ages: Array
    lengths: Array
    counts: Array
    middle: Array
    drift: Array
    head: Array
    unseen: float = 0.0
    hits: int = 0

    @classmethod
    def empty(cls, joints: int, bones: int) -> Track:
        """A new track without measurements."""
        return cls(
            -1, np.full((joints, 6), np.nan), np.zeros((joints, 3)), np.zeros(joints),
            np.full(bones, np.nan), np.zeros(bones), np.full(3, np.nan), np.zeros(3), np.full(3, np.nan),
        )  # fmt: skip

    def predict(self, dt: float, acceleration: float, joint_memory: float) -> None:
        """Predict to dt s later; joints that were not measured within `joint_memory` s are dropped."""
        self.states, self.variances = predict_motion(self.states, self.variances, dt, acceleration)
        self.ages = self.ages + dt
        self.states[self.ages > joint_memory] = np.nan
        self.unseen += dt
        self.middle = self.middle + dt * self.drift
        self.drift = self.drift * np.exp(-dt / FADE_TIME)

    def update(self, positions: Array, covariances: Array, bones: Array) -> None:
        """Update with a skeleton (J, 3) m of covariances (J, 3, 3) m^2."""
        noise = np.trace(covariances, axis1=-2, axis2=-1) / 3.0
        self.states, self.variances = update_motion(
            self.states, self.variances, positions, noise, START_SPEED
        )
        measured = np.isfinite(positions[:, 0])
        self.ages[measured] = 0.0
        lengths = bone_lengths(positions, bones)
        seen = np.isfinite(lengths)
        self.counts[seen] = np.minimum(self.counts[seen] + 1.0, LENGTH_MEMORY)
        old = np.where(np.isfinite(self.lengths), self.lengths, lengths)
        self.lengths[seen] = (old + (lengths - old) / np.maximum(self.counts, 1.0))[seen]
        self.middle = np.median(positions[measured], axis=0)
        self.drift = np.median(self.states[measured, 3:], axis=0)
        self.unseen, self.hits = 0.0, self.hits + 1


def bone_lengths(positions: Array, bones: Array) -> Array:
    """Lengths (..., B) m of bones (B, 2) of skeletons (..., J, 3), NaN where a joint is missing."""
    lengths: Array = np.linalg.norm(positions[..., bones[:, 0], :] - positions[..., bones[:, 1], :], axis=-1)
    return lengths


def joint_distances(tracks: list[Track], poses: PoseSet) -> tuple[Array, Array]:
    """Mean distances (T, P) m of predicted and measured joints, and truncated Mahalanobis distances (T, P).

    Both are means over the joints, inf without common ones. The first is for gating, the second is the cost
    of the assignment.
    """
    if not tracks or not len(poses.positions):
        nothing = np.full((len(tracks), len(poses.positions)), np.inf)
        return nothing, nothing
    predicted = np.stack([track.states[:, :3] for track in tracks])
    spread = np.stack([track.variances[:, 0] for track in tracks])
    noise = np.trace(poses.covariances, axis1=-2, axis2=-1) / 3.0
    distance = np.linalg.norm(predicted[:, None] - poses.positions[None], axis=-1)  # (T, P, J)
    known = np.isfinite(distance)
    count = known.sum(axis=-1)
    sigma = np.sqrt(spread[:, None] + np.where(np.isfinite(noise), noise, 1.0)[None] + FLOOR**2)
    scaled = np.minimum(np.where(known, distance, 0.0) / sigma, WORST)
    enough = count >= 1
    mean = np.where(known, distance, 0.0).sum(-1) / np.maximum(count, 1)
    cost = np.where(known, scaled, 0.0).sum(-1) / np.maximum(count, 1)
    return np.where(enough, mean, np.inf), np.where(enough, cost, np.inf)


FLOOR = 0.03  # m, added to the uncertainty of every joint: biases, time offsets
WORST = 10.0  # sigmas, at which distances of joints are truncated


def head_distances(tracks: list[Track], poses: PoseSet, head: int) -> Array:
    """Distances (T, P) m of the heads of skeletons from where tracks had theirs last; inf where unknown."""
    last = np.array([track.head for track in tracks]).reshape(-1, 3)
    distances = np.linalg.norm(last[:, None] - poses.positions[None, :, head], axis=-1)
    return np.where(np.isfinite(distances), distances, np.inf)


def return_costs(tracks: list[Track], poses: PoseSet, bones: Array) -> tuple[Array, Array]:
    """Distances (T, P) m of skeletons from the predicted middles of tracks, and differences of bones (T, P).

    The second is the median relative difference of bone lengths, 0 where fewer than three are known.
    """
    shape = (len(tracks), len(poses.positions))
    distances, differences = np.full(shape, np.inf), np.zeros(shape)
    lengths = bone_lengths(poses.positions, bones)
    for k, positions in enumerate(poses.positions):
        measured = np.isfinite(positions[:, 0])
        if not measured.any():
            continue
        middle = np.median(positions[measured], axis=0)
        for i, track in enumerate(tracks):
            distances[i, k] = np.linalg.norm((track.middle - middle)[:2])
            both = np.isfinite(lengths[k]) & np.isfinite(track.lengths)
            if both.sum() >= 3:
                ratio = lengths[k][both] / np.maximum(track.lengths[both], 1e-3)
                differences[i, k] = np.median(np.abs(ratio - 1.0))
    return distances, differences
