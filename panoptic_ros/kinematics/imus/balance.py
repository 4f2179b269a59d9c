"""Mountings of IMUs from balance over the feet, for a body that no camera has seen.

The centre of mass of a body lies over the feet that carry it, except for the share that its speed catches up
(Hof et al. 2005, Journal of Biomechanics 38(1)). A mounting that is off tilts legs and trunk and moves the
centre away. The distance between the two is a sum over the segments of a constant vector in the frame of
each, so it is linear in small turns of the devices. Where in the feet a person balances is a constant, too,
and is estimated beside them.
"""

from __future__ import annotations

import math

import numpy as np

from panoptic_ros.geometry.segment_chain import Chain

Array = np.ndarray
# Shares of the mass of a body (Winter 2009, Biomechanics and Motor Control of Human Movement, table 4.1), at
# the joints between which it is spread; left and right have a half each.
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
# m, where between ankle and ball, and between the feet, a person balances: 2 cm from clip to clip of recorded
# motion, and as much again, as no device tells how the spine bends that carries half of the mass.
PLACE_SD = 0.04
SWAY_SD = 0.05  # m, of the centre of mass about it: up to 4 cm in recorded standing motion, and of the spine
SWAY_S = 1.0  # for which it stays the same
CATCHING = 0.5  # of speed / frequency of the pendulum, by which the centre deviates from the feet in a step
GRAVITY = 9.81
UPRIGHT = 0.8  # share of the length of the legs; whoever has the hips lower sits, kneels or squats
FARTHEST = 0.25  # m off the feet, of somebody who leans on something, or whose feet do not carry the body


def masses_of(names: tuple[str, ...]) -> Array:
    """Shares (S,) of the mass of a body at the joints of segments; 0 at those of other names."""
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
    """Covariance (3 N, 3 N) rad^2 of how segments stand in a T-pose in which each joint is off by `spread`.

    The joints of a limb add up along it, and segments share those before them.
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


class Balance:
    """Turns (N, 3) rad of the segments under devices, each in the segment's own frame, so that they balance.

    Args:
        segments: (N,) of the devices. masses: (S,) at the joints, see `masses_of`. ground: (G,) segments
            whose joints touch the ground.
        covariance: (3 N, 3 N) rad^2, of the turns before anything is seen.
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
        """(N, 3) rad."""
        found: Array = self._state[:-2].reshape(-1, 3)
        return found

    def take_chain(self, chain: Chain) -> None:
        """Go on with other lengths."""
        self._chain = chain

    def look(self, places: Array, frames: Array, loads: Array, speed: Array, seconds: float) -> None:
        """Learn from an instant at which the body is as it is taken to be with these turns.

        Args:
            places, frames: (S, 3) m and (S, 3, 3) of the segments. loads: (G,), about how much each place on
                the ground carries, 0 to 1. speed: (2,) m/s, of the body. seconds: since the last look.
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
        """m, from the hips to the lowest ground place of the T-pose."""
        lowest = 0.0
        for s in self._ground.tolist():
            height, k = 0.0, int(s)
            while k > 0:
                height += float(self._chain.offsets[k, 2])
                k = int(self._chain.parents[k])
            lowest = min(lowest, height)
        return -lowest

    def _vectors(self, weights: Array) -> Array:
        """(S, 3) m in the frames of the segments, whose sum is what weights (S,) of the joints make."""
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
        turned = np.cross(np.eye(3)[None], arms[:, None]).swapaxes(1, 2)  # (S, 3, 3), by turns in the world
        found = np.empty((2, size))
        for n, s in enumerate(self._segments.tolist()):
            moved = np.tensordot(self._shares[:, n], turned, 1) @ frames[s]
            found[:, 3 * n : 3 * n + 3] = moved[:2]
        found[:, size - 2 :] = -np.array([[ahead[0], -ahead[1]], [ahead[1], ahead[0]]])
        return found


def _shares(parents: Array, segments: Array) -> Array:
    """Return the share (S, N) with which each segment turns with each device: half between two devices."""
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
