"""What is known of a body between two instants, besides what cameras see at them.

`Contact` follows the feet while no camera sees the body: which one carries it, and where each stands.

A foot that stands hardly turns and hardly accelerates, however high the ground is under it; that tells it
apart from one that moves, as in foot-mounted inertial navigation (Skog et al. 2010, IEEE Transactions on
Biomedical Engineering 57(11)). The foot at rest carries the root. Where the others at rest came to stand is
kept, as legged robots do (Bloesch et al. 2012, Robotics: Science and Systems): a body that shifts its weight
from one foot to the other and back stays where it was, although the legs are not quite as they seem.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping

import numpy as np

from panoptic_ros.geometry.chain import Pose, place_segments
from panoptic_ros.geometry.rotations import vectors_of
from panoptic_ros.geometry.segment_chain import Chain
from panoptic_ros.kinematics.body.evidence import Weighing
from panoptic_ros.kinematics.imus.devices import WornDevices
from panoptic_ros.kinematics.pose.targets import (
    NO_ACCELERATIONS,
    NOTHING_STANDS,
    Between,
    Standing,
    Turning,
)

Array = np.ndarray

REST_TURN, REST_ACCELERATION = 3.0, 8.0  # rad/s and m/s^2 of a foot that may stand: soft tissue, and rolling
STANDING_SD = 0.002  # m between two instants, at rest
SPAN_S = 0.1  # over which unrest is averaged
APART_SPEED = 0.2  # m/s between two feet of which one moves
CATCH_UP_S = 0.1  # in which the body comes back to where its feet stand
UNSEEN_S = 1.0  # without cameras, after which the root's own acceleration is not trusted


class Contact:
    """Feet of one body, instant by instant.

    Args:
        ground: (G,) segments whose places touch the ground; those of a foot hang on one another.
    """

    def __init__(self, parents: Array, ground: Array, rate_hz: float):
        self._ground, self._rate = ground, rate_hz
        tops = [self._top(int(s), parents, set(ground.tolist())) for s in ground]
        self._tops = list(dict.fromkeys(tops))  # the first segment of each foot
        self._above = [int(parents[top]) for top in self._tops]
        self._feet = [np.flatnonzero(np.array(tops) == top) for top in self._tops]  # rows of `ground`
        span = max(round(SPAN_S * rate_hz), 1)
        self._unrest: deque[Array] = deque(maxlen=span)
        self._apart: deque[Array] = deque(maxlen=span)
        self._before: Array | None = None  # (G, 3)
        self._stood: Array | None = None  # (G, 3), where each came to rest

    def step(
        self, chain: Chain, pose: Pose, rates: Mapping[int, float], accelerations: Mapping[int, float]
    ) -> Standing:
        """What stands until the next instant.

        Args:
            pose: of the instant before. rates, accelerations: by segment, rad/s and m/s^2, as IMUs tell.
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
        return Standing(np.array([site]), np.zeros((1, 3)), move[None], np.array([spread**-2]))

    @property
    def loads(self) -> Array:
        """About how much (G,) each place on the ground carries, 0 to 1: that of a foot at rest much."""
        found = np.zeros(len(self._ground))
        for rows, unrest in zip(self._feet, np.mean(self._unrest, axis=0) if self._unrest else ()):
            found[rows] = 1.0 / (1.0 + unrest**2)
        return found

    def forget(self) -> None:
        """The body is elsewhere."""
        self._unrest.clear()
        self._apart.clear()
        self._before = self._stood = None

    def _restless(self, rates: Mapping[int, float], accelerations: Mapping[int, float]) -> Array:
        """How much (F,) each foot turns and accelerates, in squares of what is usual at rest."""
        now = np.zeros(len(self._tops))
        for f, (top, above) in enumerate(zip(self._tops, self._above)):
            worn = top if top in rates else above
            now[f] = (rates.get(worn, 0.0) / REST_TURN) ** 2
            now[f] += (accelerations.get(worn, 0.0) / REST_ACCELERATION) ** 2
        self._unrest.append(now)
        found: Array = np.mean(self._unrest, axis=0)
        return found

    def _carrying(self, unrest: Array, heights: Array, rates: Mapping[int, float]) -> int:
        """The foot that is most at rest; the lowest one, where not all feet have an IMU."""
        return int(np.argmin(unrest if all(top in rates for top in self._tops) else heights))

    def _moving_apart(self, sites: Array, carrying: int) -> Array:
        """Speeds (F,) m/s of the feet against the one that carries the body."""
        moves = self._rate * (sites - (sites if self._before is None else self._before))
        self._before = sites
        own = moves[self._feet[carrying]]
        between = [moves[foot][:, None] - own[None] for foot in self._feet]
        self._apart.append(np.array([np.linalg.norm(speeds, axis=-1).min() for speeds in between]))
        found: Array = np.mean(self._apart, axis=0)
        return found

    def _way_back(self, sites: Array, lowest: list[int], at_rest: Array, unrest: Array) -> Array:
        """How far (3,) m the body goes until the next instant, for its feet to be where they came to rest."""
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


class BetweenInstants:
    """Accelerations and turns by IMUs and, while no camera sees the body, the foot that carries it."""

    def __init__(self, chain: Chain, weighing: Weighing, rate_hz: float):
        self._rate_hz = rate_hz
        self._contact = Contact(chain.parents, weighing.floor.segments, rate_hz)
        self._unseen_s = 0.0 if len(weighing.rotations) else math.inf

    def passed(self, seconds: float, seen: bool) -> None:
        """So much time has passed since the instant before; seen: at this one, by cameras."""
        self._unseen_s = 0.0 if seen else self._unseen_s + seconds

    @property
    def loads(self) -> Array:
        """About how much (G,) each place on the ground carries, 0 to 1; 0 while cameras see the body."""
        return self._contact.loads

    def told(
        self,
        devices: WornDevices,
        oriented: tuple[Array, Array],
        body: tuple[Chain, Pose],
        begun: bool,
        stride: int,
    ) -> Between:
        """Until this instant.

        Args:
            oriented: see `WornDevices.orientations`. body: at the instant before.
            begun: whether there are two instants before. stride: periods since the last one.
        """
        turning = devices.turning(*oriented, stride)
        free = self._unseen_s > UNSEEN_S
        accelerations = devices.accelerations(free, stride) if begun else NO_ACCELERATIONS
        return Between(accelerations, turning, self._standing(devices, turning, body, stride), stride)

    def _standing(
        self, devices: WornDevices, turning: Turning, body: tuple[Chain, Pose], stride: int
    ) -> Standing:
        """What carries the body, while no camera sees it."""
        if self._unseen_s <= UNSEEN_S:
            self._contact.forget()
            return NOTHING_STANDS
        rate = self._rate_hz / stride
        angles = np.linalg.norm(vectors_of(np.ascontiguousarray(turning.changes)), axis=-1)
        rates = dict(zip(turning.segments.tolist(), (rate * angles).tolist()))
        return self._contact.step(*body, rates, devices.shaken())
