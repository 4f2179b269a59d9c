"""Mountings of IMUs from balance over the feet, for a body that no camera has seen.

The centre of mass of a body lies over the feet that carry it, except for an offset in proportion to its
speed. See Hof et al. 2005, Journal of Biomechanics 38(1). A wrong mounting tilts legs and trunk and moves the
centre of mass away. The distance between the two is a sum of one vector per segment that is constant in the
frame of that segment. It is therefore linear in small rotations of the devices. The place within the feet
over which a person balances is a constant too, and is estimated together with the rotations.
"""

from __future__ import annotations

import math

import numpy as np

from panoptic_ros.geometry.segment_chain import Chain

Array = np.ndarray
# Fractions of the mass of a body (Winter 2009, Biomechanics and Motor Control of Human Movement, table 4.1),
# at the joints between which it is spread. Left and right have half each.
MASSES = {
    "hips": 0.071,
    "Thigh": 0.184,
    "Shin": 0.139,
    "Foot": 0.055,
    "Toe": 0.015,
    "spine1": 0.042,
    "spine3": 0.097,
    "spine4": 0.086,
    "neck": 0.130,
    "head": 0.081,
    "UpperArm": 0.032,
    "Forearm": 0.042,
    "Hand": 0.026,
}
# m, place of balance between ankle and ball and between the feet. It varies by 2 cm from clip to clip of
# recorded motion. Another 2 cm allow for the bend of the spine. It carries half of the mass, and no device
# measures it.
PLACE_SD = 0.04
# m, sway of the centre of mass about that place: up to 4 cm in recorded standing motion, plus the spine
SWAY_SD = 0.05
SWAY_S = 1.0  # correlation time of this sway, s
CATCHING = 0.5  # fraction of speed / pendulum frequency by which the centre of mass leaves the feet in a step
GRAVITY = 9.81
UPRIGHT = 0.8  # fraction of the leg length: if the hips are lower, a person sits, kneels or squats
# m, maximum offset from the feet: beyond it, a person leans on something or does not stand on the feet
FARTHEST = 0.25


def masses_of(names: tuple[str, ...]) -> Array:
    """Return the fractions (S,) of the body mass at the joints of segments; 0 for names without an entry."""
    paired = [name[:1] in "lr" and name[1:2].isupper() for name in names]
    found = np.array(
        [
            0.5 * MASSES.get(name[1:], 0.0) if pair else MASSES.get(name, 0.0)
            for name, pair in zip(names, paired)
        ]
    )
    total = float(found.sum())
    shares: Array = found / total if total else found
    return shares


def t_pose_turns(parents: Array, segments: Array, spread: float) -> Array:
    """Return the covariance (3 N, 3 N) rad^2 of the segments' orientations in a T-pose.

    Each joint has the standard deviation `spread`, rad. The errors of joints add up along a limb, and
    segments share the errors of the joints before them.
    """
    above = np.zeros((len(parents), len(parents)))
    for s in range(len(parents)):
        k = s
        while k >= 0:
            above[s, k] = 1.0
            k = int(parents[k])
    rows = above[segments]
    found: Array = np.kron(spread**2 * rows @ rows.T, np.eye(3))
    return found


class BalanceEstimate:
    """Rotations (N, 3) rad of the segments under devices, estimated from balance.

    Each is in the frame of its segment.

    Args:
        segments: (N,) of the devices.
        masses: (S,) at the joints, see `masses_of`.
        ground: (G,) segments whose joints touch the ground.
        covariance: (3 N, 3 N) rad^2, of the rotations before any observation.
    """

    def __init__(self, chain: Chain, segments: Array, masses: Array, ground: Array, covariance: Array):
        self._chain, self._segments, self._masses, self._ground = chain, segments, masses, ground
        self._shares = _shares(chain.parents, segments)
        size = len(covariance)
        self._information, self._pull = np.zeros((size + 2, size + 2)), np.zeros(size + 2)
        self._information[:size, :size] = np.linalg.inv(covariance)
        self._information[size:, size:] = PLACE_SD**-2 * np.eye(2)
        self._state = np.zeros(size + 2)

    @property
    def turns(self) -> Array:
        """Return the rotations (N, 3) rad."""
        found: Array = self._state[:-2].reshape(-1, 3)
        return found

    def take_chain(self, chain: Chain) -> None:
        """Continue with other segment lengths."""
        self._chain = chain

    def look(self, places: Array, frames: Array, loads: Array, speed: Array, seconds: float) -> None:
        """Learn from an instant, at the pose that results with the current rotations.

        Args:
            places, frames: (S, 3) m and (S, 3, 3) of the segments.
            loads: (G,), approximate load of each ground segment, 0 to 1.
            speed: (2,) m/s, of the body.
            seconds: s since the last observation.
        """
        carried = float(loads.sum())
        if not self._masses.any() or loads.max(initial=0.0) < 0.5:
            return
        weights = self._masses.copy()
        np.add.at(weights, self._ground, -loads / carried)
        vectors = self._vectors(weights)
        off = (weights @ places)[:2]
        below = places[self._ground[int(loads.argmax())], 2]
        if np.hypot(*off) > FARTHEST or places[0, 2] - below < UPRIGHT * self._legs():
            return
        ahead = frames[0, :2, 0] / max(float(np.hypot(*frames[0, :2, 0])), 1e-6)
        slopes = self._slopes(frames, vectors, ahead)
        height = max(float(self._masses @ places[:, 2] - below), 0.1)
        caught = CATCHING * math.sqrt(height / GRAVITY) * speed
        spread = SWAY_SD**2 * np.eye(2) + np.outer(caught, caught)
        information = seconds / SWAY_S * np.linalg.inv(spread)
        self._information += slopes.T @ information @ slopes
        self._pull += slopes.T @ information @ (slopes @ self._state - self._residual(off, ahead))
        self._state[:] = np.linalg.solve(self._information, self._pull)

    def _residual(self, off: Array, ahead: Array) -> Array:
        """Return the offset (2,) m, world, of the centre of mass from the estimated place of balance."""
        forwards, left = self._state[-2:]
        found: Array = off - forwards * ahead - left * np.array([-ahead[1], ahead[0]])
        return found

    def _legs(self) -> float:
        """Return the length of the legs, m, from the hips to the lowest ground joint of the T-pose."""
        lowest = 0.0
        for s in self._ground.tolist():
            height, k = 0.0, int(s)
            while k > 0:
                height += float(self._chain.offsets[k, 2])
                k = int(self._chain.parents[k])
            lowest = min(lowest, height)
        return -lowest

    def _vectors(self, weights: Array) -> Array:
        """Return the vectors (S, 3) m whose sum is the weighted sum of the joints.

        Each vector is in the frame of its segment.

        Args:
            weights: (S,), weights of the joints.
        """
        beyond, found = weights.copy(), np.zeros((len(weights), 3))
        for s in range(len(weights) - 1, 0, -1):
            parent = int(self._chain.parents[s])
            beyond[parent] += beyond[s]
            found[parent] += beyond[s] * self._chain.offsets[s]
        return found

    def _slopes(self, frames: Array, vectors: Array, ahead: Array) -> Array:
        """Return the Jacobian (2, 3 N + 2) of the residual: turns (rad), place of balance (m)."""
        size = len(self._state)
        arms = (frames @ vectors[..., None])[..., 0]
        # (S, 3, 3), derivatives by rotations in the world
        turned = np.cross(np.eye(3)[None], arms[:, None]).swapaxes(1, 2)
        found = np.empty((2, size))
        for n, s in enumerate(self._segments.tolist()):
            moved = np.tensordot(self._shares[:, n], turned, 1) @ frames[s]
            found[:, 3 * n : 3 * n + 3] = moved[:2]
        found[:, size - 2 :] = -np.array([[ahead[0], -ahead[1]], [ahead[1], ahead[0]]])
        return found


def _shares(parents: Array, segments: Array) -> Array:
    """Return the fraction (S, N) of each device's rotation that each segment takes.

    It is half for segments between two devices.
    """
    found = np.zeros((len(parents), len(segments)))
    rows = {int(s): n for n, s in enumerate(segments.tolist())}
    for s in range(len(parents)):
        above = s
        while above >= 0 and above not in rows:
            above = int(parents[above])
        below = s
        while below >= 0 and below not in rows:
            children = np.flatnonzero(parents == below)
            below = int(children[0]) if len(children) == 1 else -1
        for k in (above, below):
            if k >= 0:
                found[s, rows[k]] += 0.5
    total = found.sum(1, keepdims=True)
    shares: Array = np.divide(found, total, out=np.zeros_like(found), where=total > 0.0)
    return shares
