"""How IMUs sit on their segments, kept uncertain: mounting of each, and the heading that they share.

At single instants, cameras and prior tell the orientation of a segment apart from its IMU. What they tell
is wrong
by about the same at all instants, so information is averaged over instants, never added up: a mounting is
known no
better than a few looks at the body allow, whatever the length of the recording. How far mountings are off
at all is
learnt from all devices together (empirical Bayes), so that a good T-pose is kept and a poor one is mended.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from panoptic_ros.geometry.chain import Chain, Pose, turn_slopes
from panoptic_ros.geometry.rotations import rotations_of, turn_about_z, vectors_of
from panoptic_ros.kinematics.config import KinematicsConfig
from panoptic_ros.kinematics.normal_equations import assemble
from panoptic_ros.kinematics.targets import Evidence, no_anchor

Array = np.ndarray
MEMORY = 100  # looks over which information is averaged
DEVICE_TRUST = 3.0  # how many measurements the common deviation of mountings counts as, for one device
COMMON_TRUST = 6.0  # the same for the stated deviation, against all devices
MOST_SD = math.radians(60.0)


class MountingEstimate:
    """Corrections of heading and mountings: a device's segment is at turn(heading) goal exp(mounting).

    Args:
        segments: (N,) of the devices.
        heading_sd: rad, of the heading at the start.
    """

    def __init__(self, config: KinematicsConfig, chain: Chain, segments: Array, heading_sd: float):
        self._config, self._chain, self._segments = config, chain, segments
        self._heading_sd = heading_sd
        size = 1 + 3 * len(segments)
        self._information, self._pull, self._looks = np.zeros((size, size)), np.zeros(size), 0
        self.heading, self.mountings = 0.0, np.zeros((len(segments), 3))
        self._common = math.radians(config.mounting_sd)
        self._strap = math.radians(config.strap_sd)
        self.spreads = np.full(len(segments), math.hypot(self._common, self._strap))

    def corrected(self, goals: Array, which: Array) -> Array:
        """Orientations (M, 3, 3) of the segments of these devices (M,)."""
        found: Array = turn_about_z(self.heading) @ goals @ rotations_of(self.mountings[which])
        return found

    def look(self, pose: Pose, seen: Evidence, goals: Array, which: Array) -> None:
        """Learn from an instant.

        Args:
            seen: all but the orientations. goals: (M, 3, 3) uncorrected, of the devices in `which` (M,).
        """
        size = len(pose.turns) * 3 + 3
        hessian, gradient = np.empty((size, size)), np.empty(size)
        assemble(self._chain, pose, seen, no_anchor(len(pose.turns)), hessian, gradient)
        slopes = np.empty((len(which), 3, size))
        frames = turn_slopes(self._chain, pose, self._segments[which], slopes)
        corrected = self.corrected(goals, which)
        apart = vectors_of(np.ascontiguousarray(frames @ corrected.swapaxes(1, 2)))
        constants = np.zeros((len(which), 3, len(self._pull)))
        constants[:, 2, 0] = -1.0
        for m, device in enumerate(which):
            constants[m, :, 1 + 3 * device : 4 + 3 * device] = -corrected[m]
        weight = self._strap**-2
        j, c = slopes.reshape(-1, size), constants.reshape(-1, len(self._pull))
        e = apart.ravel()
        inner = cho_factor(hessian + weight * j.T @ j + 1e-6 * np.eye(size), check_finite=False)
        cross = weight * j.T @ c
        solved = cho_solve(inner, np.column_stack([cross, gradient + weight * j.T @ e]), check_finite=False)
        information = weight * c.T @ c - cross.T @ solved[:, :-1]
        pull = weight * c.T @ e - cross.T @ solved[:, -1] - information @ self._state()
        self._looks += 1
        share = 1.0 / min(self._looks, MEMORY)
        self._information += share * (information - self._information)
        self._pull += share * (pull - self._pull)
        self._update()

    def _state(self) -> Array:
        state: Array = np.r_[self.heading, self.mountings.ravel()]
        return state

    def _update(self) -> None:
        """The most likely corrections, and how far mountings are off at all."""
        looks = min(self._config.looks, float(self._looks))
        stated = math.radians(self._config.mounting_sd)
        count = len(self._segments)
        own = np.full(count, self._common)
        for _ in range(4):
            precision = np.r_[self._heading_sd**-2, np.repeat(own**-2, 3)]
            matrix = looks * self._information + np.diag(precision)
            covariance = np.linalg.inv(matrix)
            state = -covariance @ (looks * self._pull)
            squares = (state[1:].reshape(-1, 3) ** 2).sum(1) / 3.0
            squares += np.diag(covariance)[1:].reshape(-1, 3).mean(1)
            typical = float(np.median(squares))
            common2 = (COMMON_TRUST * stated**2 + count * typical) / (COMMON_TRUST + count)
            self._common = math.sqrt(common2)
            own = np.sqrt((DEVICE_TRUST * common2 + 3.0 * squares) / (DEVICE_TRUST + 3.0))
            own = np.minimum(own, MOST_SD)
        self.heading, self.mountings = float(state[0]), state[1:].reshape(-1, 3)
        left = np.diag(covariance)[1:].reshape(-1, 3).mean(1)
        self.spreads = np.sqrt(left + self._strap**2)
