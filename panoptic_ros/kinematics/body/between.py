"""Measurements of a body between two instants, apart from what cameras see at these instants.

`FootContacts` tracks the feet while no camera sees the body. It finds the foot that carries the body, and the
place where each foot stands.

A standing foot hardly rotates and hardly accelerates, whatever the height of the ground below it. This
distinguishes it from a moving foot, as in foot-mounted inertial navigation (Skog et al. 2010, IEEE
Transactions on Biomedical Engineering 57(11)). The foot at rest carries the root. The places where the other
resting feet came to rest are kept, as for legged robots (Bloesch et al. 2012, Robotics: Science and Systems).
A body that shifts its weight from one foot to the other and back therefore stays in place, although the
modelled legs are not exact.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping

import numpy as np

from panoptic_ros.geometry.chain import Pose, place_segments
from panoptic_ros.geometry.rotations import vectors_of
from panoptic_ros.geometry.segment_chain import Chain
from panoptic_ros.kinematics.body.evidence import EvidenceBuilder
from panoptic_ros.kinematics.imus.devices import WornDevices
from panoptic_ros.kinematics.pose.targets import (
    NO_ACCELERATIONS,
    NOTHING_STANDS,
    IncrementEvidence,
    RotationIncrements,
    SiteDisplacements,
)

Array = np.ndarray

# rad/s and m/s^2, usual motion of a standing foot: soft tissue, and rolling
REST_TURN, REST_ACCELERATION = 3.0, 8.0
STANDING_SD = 0.002  # m, displacement of a resting foot between two instants
SPAN_S = 0.1  # averaging time of the unrest
APART_SPEED = 0.2  # relative speed, m/s, above which one of two feet moves
CATCH_UP_S = 0.1  # time constant with which the body returns to where its feet stand
UNSEEN_S = 1.0  # time without cameras after which the acceleration of the root is not trusted


class FootContacts:
    """Ground contacts of the feet of one body, one instant at a time.

    Args:
        ground: (G,) segments whose proximal joints touch the ground. Those of one foot are connected.
    """

    def __init__(self, parents: Array, ground: Array, rate_hz: float):
        self._ground, self._rate = ground, rate_hz
        tops = [self._top(int(s), parents, set(ground.tolist())) for s in ground]
        self._tops = list(dict.fromkeys(tops))  # proximal segment of each foot
        self._above = [int(parents[top]) for top in self._tops]
        # rows of `ground`, by foot
        self._feet = [np.flatnonzero(np.array(tops) == top) for top in self._tops]
        span = max(round(SPAN_S * rate_hz), 1)
        self._unrest: deque[Array] = deque(maxlen=span)
        self._apart: deque[Array] = deque(maxlen=span)
        self._before: Array | None = None  # (G, 3) m, positions at the previous instant
        self._stood: Array | None = None  # (G, 3) m, where each came to rest

    def step(
        self, chain: Chain, pose: Pose, rates: Mapping[int, float], accelerations: Mapping[int, float]
    ) -> SiteDisplacements:
        """Return the site of the carrying foot and its displacement until the next instant.

        Args:
            pose: Pose at the previous instant.
            rates, accelerations: rad/s and m/s^2 by segment, as measured by IMUs.
        """
        if not self._feet:
            return NOTHING_STANDS
        frames, places = np.empty((len(chain.parents), 3, 3)), np.empty((len(chain.parents), 3))
        place_segments(chain, pose, frames, places)
        sites = places[self._ground]
        lowest = [int(foot[np.argmin(sites[foot, 2])]) for foot in self._feet]
        unrest = self._restless(rates, accelerations)
        carrying = self._carrying(unrest, sites[lowest, 2], rates)
        apart = self._moving_apart(sites, carrying)
        at_rest = (unrest < 1.0) & ((apart < APART_SPEED) | (np.arange(len(apart)) == carrying))
        move = self._way_back(sites, lowest, at_rest, unrest)
        spread = STANDING_SD * (1.0 + unrest[carrying] ** 2)
        site = self._ground[lowest[carrying]]
        return SiteDisplacements(np.array([site]), np.zeros((1, 3)), move[None], np.array([spread**-2]))

    @property
    def loads(self) -> Array:
        """Return the approximate load (G,) of each ground segment, 0 to 1. A resting foot has a high load."""
        found = np.zeros(len(self._ground))
        for rows, unrest in zip(self._feet, np.mean(self._unrest, axis=0) if self._unrest else ()):
            found[rows] = 1.0 / (1.0 + unrest**2)
        return found

    def forget(self) -> None:
        """Forget all contacts, because the body is elsewhere."""
        self._unrest.clear()
        self._apart.clear()
        self._before = self._stood = None

    def _restless(self, rates: Mapping[int, float], accelerations: Mapping[int, float]) -> Array:
        """Return the unrest (F,) of each foot, averaged over time.

        It is the sum of squared rotation rate and squared acceleration, each relative to its usual value at
        rest.
        """
        now = np.zeros(len(self._tops))
        for f, (top, above) in enumerate(zip(self._tops, self._above)):
            worn = top if top in rates else above
            now[f] = (rates.get(worn, 0.0) / REST_TURN) ** 2
            now[f] += (accelerations.get(worn, 0.0) / REST_ACCELERATION) ** 2
        self._unrest.append(now)
        found: Array = np.mean(self._unrest, axis=0)
        return found

    def _carrying(self, unrest: Array, heights: Array, rates: Mapping[int, float]) -> int:
        """Return the foot with the least unrest, or the lowest foot if not all feet have an IMU."""
        return int(np.argmin(unrest if all(top in rates for top in self._tops) else heights))

    def _moving_apart(self, sites: Array, carrying: int) -> Array:
        """Return the speed (F,) m/s of each foot relative to the carrying foot, averaged over time."""
        moves = self._rate * (sites - (sites if self._before is None else self._before))
        self._before = sites
        own = moves[self._feet[carrying]]
        between = [moves[foot][:, None] - own[None] for foot in self._feet]
        self._apart.append(np.array([np.linalg.norm(speeds, axis=-1).min() for speeds in between]))
        found: Array = np.mean(self._apart, axis=0)
        return found

    def _way_back(self, sites: Array, lowest: list[int], at_rest: Array, unrest: Array) -> Array:
        """Return the displacement (3,) m until the next instant that restores the feet's resting places."""
        stood = sites.copy() if self._stood is None else self._stood
        kept = [row for f, row in enumerate(lowest) if at_rest[f]]
        others = np.setdiff1d(np.arange(len(sites)), kept)
        stood[others] = sites[others]
        self._stood = stood
        if not kept:
            return np.zeros(3)
        weights = 1.0 / (1.0 + unrest[at_rest] ** 2)
        off = np.average(stood[kept] - sites[kept], axis=0, weights=weights)
        found: Array = min(1.0 / (self._rate * CATCH_UP_S), 1.0) * off
        return found

    @staticmethod
    def _top(segment: int, parents: Array, ground: set[int]) -> int:
        while int(parents[segment]) in ground:
            segment = int(parents[segment])
        return segment


class IncrementEvidenceBuilder:
    """Accelerations and rotations from IMUs and, while no camera sees the body, the foot that carries it."""

    def __init__(self, chain: Chain, weighing: EvidenceBuilder, rate_hz: float):
        self._rate_hz = rate_hz
        self._contact = FootContacts(chain.parents, weighing.floor.segments, rate_hz)
        self._unseen_s = 0.0 if len(weighing.rotations) else math.inf

    def passed(self, seconds: float, seen: bool) -> None:
        """Record the time since the previous instant, s.

        Args:
            seen: True if cameras see the body at this instant.
        """
        self._unseen_s = 0.0 if seen else self._unseen_s + seconds

    @property
    def loads(self) -> Array:
        """Return the approximate load (G,) of each ground segment, 0 to 1; 0 while cameras see the body."""
        return self._contact.loads

    def told(
        self,
        devices: WornDevices,
        oriented: tuple[Array, Array],
        body: tuple[Chain, Pose],
        begun: bool,
        stride: int,
    ) -> IncrementEvidence:
        """Return the measurements between the previous instant and this one.

        Args:
            oriented: See `WornDevices.orientations`.
            body: Chain, and pose at the previous instant.
            begun: True if there are two previous instants.
            stride: Number of periods since the previous instant.
        """
        turning = devices.turning(*oriented, stride)
        free = self._unseen_s > UNSEEN_S
        accelerations = devices.accelerations(free, stride) if begun else NO_ACCELERATIONS
        return IncrementEvidence(
            accelerations, turning, self._standing(devices, turning, body, stride), stride
        )

    def _standing(
        self, devices: WornDevices, turning: RotationIncrements, body: tuple[Chain, Pose], stride: int
    ) -> SiteDisplacements:
        """Return the site of the carrying foot while no camera sees the body."""
        if self._unseen_s <= UNSEEN_S:
            self._contact.forget()
            return NOTHING_STANDS
        rate = self._rate_hz / stride
        angles = np.linalg.norm(vectors_of(np.ascontiguousarray(turning.changes)), axis=-1)
        rates = dict(zip(turning.segments.tolist(), (rate * angles).tolist()))
        return self._contact.step(*body, rates, devices.shaken())
