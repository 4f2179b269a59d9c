"""What is known of a body between two instants, besides what cameras see at them."""

from __future__ import annotations

import math

import numpy as np

from panoptic_ros.geometry.chain import Pose
from panoptic_ros.geometry.rotations import vectors_of
from panoptic_ros.geometry.segment_chain import Chain
from panoptic_ros.kinematics.body.contact import Contact
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
UNSEEN_S = 1.0  # without cameras, after which the root's own acceleration is not trusted


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
