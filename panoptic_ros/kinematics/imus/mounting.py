"""Estimate of the mountings of IMUs on their segments, and of the heading that these IMUs share.

At single instants, cameras and prior determine the orientation of a segment independently of its IMU. The
errors of that orientation are about the same at all instants. Information is therefore averaged over
instants, never summed. The uncertainty of a mounting is that of a few independent observations, whatever the
length of the recording.

The standard deviation of mountings is learnt from all devices together (empirical Bayes). A good T-pose is
thus kept, and a poor one is corrected. A mounting that is far off, compared with all others, is a mistake,
and the prior does not hold back its correction. If the newest observations contradict the older ones, the
device has slipped, and the older ones are forgotten.
"""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from panoptic_ros.geometry.chain import Pose, turn_slopes
from panoptic_ros.geometry.rotations import rotations_of, turn_about_z, vectors_of
from panoptic_ros.geometry.segment_chain import Chain
from panoptic_ros.kinematics.config import KinematicsConfig
from panoptic_ros.kinematics.pose.normal_equations import assemble
from panoptic_ros.kinematics.pose.positive_matrices import inverse_of
from panoptic_ros.kinematics.pose.targets import PoseEvidence, no_anchor

Array = np.ndarray
MEMORY = 100  # maximum number of observations in the average
DEVICE_TRUST = 3.0  # weight of the common standard deviation of mountings, in measurements of one device
COMMON_TRUST = 6.0  # weight of the stated standard deviation of mountings, in devices
MOST_SD = math.radians(60.0)  # rad, maximum standard deviation of a mounting, and that of a mistaken mounting
# minimum error of a mistaken mounting: rad, and common standard deviations of mountings
MISTAKEN, MISTAKEN_SDS = math.radians(14.0), 3.0
# rad, standard deviation of the wide prior of a mounting; number of iterations of the standard deviations
WIDE, ROUNDS = math.radians(25.0), 4
FEWEST_LOOKS = 5  # minimum number of observations before anything is reported
RECENT = 12  # number of newest observations that are compared with the older ones
# minimum change of a slipped mounting, in its standard deviations; minimum number of consecutive looks at it
SLIPPED_SDS, SLIPPED_LOOKS = 3.3, 6
FEWEST_BEFORE = 8  # minimum number of older observations for the comparison of recent with older ones
UNKNOWN = 1e-9  # 1/rad^2, information about components that no data determine
MISTAKEN_SPREADS = 2.2  # minimum error of a mistaken mounting, in the standard deviations of its estimate
TOLD = math.radians(20.0)  # rad, minimum mounting error that is reported as a mistake
HEADING_TRUST = 2.0  # weight of the stated heading standard deviation, in measurements
LATE_HEADING = math.radians(5.0)  # rad, minimum heading error that is reported


class MeanObservation(NamedTuple):
    """Average of the observations of N devices.

    Attributes:
        information, pull: Hessian (1 + 3 N, 1 + 3 N) and gradient (1 + 3 N,), at zero corrections, of the
            cost of the heading and the mountings.
        number: Number of observations in the average.
    """

    information: Array
    pull: Array
    number: int


def _both(one: MeanObservation, other: MeanObservation) -> MeanObservation:
    count = one.number + other.number
    information, pull = ((one.number * a + other.number * b) / count for a, b in zip(one[:2], other[:2]))
    return MeanObservation(information, pull, count)


class MountingEstimate:
    """Corrections of heading and mountings: a device's segment is at turn(heading) goal exp(mounting).

    Args:
        segments: (N,) of the devices.
        unseen: (N, 3) axes of the segments about which cameras do not observe rotations, 0 = none.
    """

    def __init__(self, config: KinematicsConfig, chain: Chain, segments: Array, unseen: Array):
        self._config, self._chain, self._segments = config, chain, segments
        self._heading_sd, self._unseen = math.radians(config.heading_sd), unseen
        size = 1 + 3 * len(segments)
        self._older, self._looks = MeanObservation(np.zeros((size, size)), np.zeros(size), 0), 0
        self.heading, self.mountings = 0.0, np.zeros((len(segments), 3))
        self._common = math.radians(config.mounting_sd)
        self._strap = math.radians(config.strap_sd)
        self.spreads = np.full(len(segments), math.hypot(self._common, self._strap))
        self._recent: deque[tuple[Array, Array]] = deque(maxlen=RECENT)
        self._several = True  # several views see the person
        # device that may have slipped, and number of consecutive observations of that
        self._suspect, self._moved = -1, 0
        self.mistaken = np.zeros(len(segments), bool)
        self.slipped: list[int] = []

    @property
    def heading_off(self) -> bool:
        """Return whether the heading error of the inertial frame is to be reported."""
        return abs(self.heading) > LATE_HEADING and self._looks >= FEWEST_BEFORE

    @property
    def looks(self) -> int:
        """Return the number of observations by cameras so far."""
        return self._looks

    def take_chain(self, chain: Chain) -> None:
        """Continue with other segment lengths."""
        self._chain = chain

    def corrected(self, goals: Array, which: Array) -> Array:
        """Return the corrected orientations (M, 3, 3) of the segments of devices `which` (M,)."""
        found: Array = turn_about_z(self.heading) @ goals @ rotations_of(self.mountings[which])
        return found

    def look(self, pose: Pose, seen: PoseEvidence, oriented: tuple[Array, Array], several: bool) -> None:
        """Learn from an instant.

        Args:
            seen: All evidence except the orientations.
            oriented: (M, 3, 3), uncorrected orientations of segments, and (M,), their devices.
            several: True if several views see the person. A single view confuses limbs that point towards it
                with limbs that point away. It therefore flags no device as mistaken or slipped.
        """
        (goals, which), self._several = oriented, several
        size = len(pose.turns) * 3 + 3
        hessian, gradient = np.empty((size, size)), np.empty(size)
        assemble(self._chain, pose, seen, no_anchor(len(pose.turns)), hessian, gradient)
        slopes = np.empty((len(which), 3, size))
        frames = turn_slopes(self._chain, pose, self._segments[which], slopes)
        corrected = self.corrected(goals, which)
        apart = vectors_of(np.ascontiguousarray(frames @ corrected.swapaxes(1, 2)))
        constants = np.zeros((len(which), 3, 1 + self.mountings.size))
        constants[:, 2, 0] = -1.0
        for m, device in enumerate(which):
            constants[m, :, 1 + 3 * device : 4 + 3 * device] = -corrected[m]
        weight = self._strap**-2
        j, c = slopes.reshape(-1, size), constants.reshape(-1, 1 + self.mountings.size)
        e = apart.ravel()
        inner = cho_factor(hessian + weight * j.T @ j + 1e-6 * np.eye(size), check_finite=False)
        cross = weight * j.T @ c
        solved = cho_solve(inner, np.column_stack([cross, gradient + weight * j.T @ e]), check_finite=False)
        information = weight * c.T @ c - cross.T @ solved[:, :-1]
        pull = weight * c.T @ e - cross.T @ solved[:, -1] - information @ self._state()
        self._take(information, pull)
        self._update()

    def _state(self) -> Array:
        state: Array = np.r_[self.heading, self.mountings.ravel()]
        return state

    def _take(self, information: Array, pull: Array) -> None:
        """Add an observation. The oldest of the recent ones moves into the average of the older ones."""
        if len(self._recent) == RECENT:
            count = min(self._older.number + 1, MEMORY - RECENT)
            (information_before, pull_before, _), (first, second) = self._older, self._recent[0]
            self._older = MeanObservation(
                information_before + (first - information_before) / count,
                pull_before + (second - pull_before) / count,
                count,
            )
        self._recent.append((information, pull))

    def _newest(self) -> MeanObservation:
        """Return the average of the recent observations."""
        information, pull = (np.mean(parts, axis=0) for parts in zip(*self._recent))
        return MeanObservation(information, pull, len(self._recent))

    def _update(self) -> None:
        """Update corrections, common standard deviation, and mistaken and slipped devices."""
        newest, self.slipped = self._newest(), []
        if self._older.number > FEWEST_BEFORE and self._several:
            slipped = self._slip(newest)
            self._moved = self._moved + 1 if slipped == self._suspect else 1
            self._suspect = slipped
            if slipped >= 0 and self._moved >= SLIPPED_LOOKS:
                self.slipped, self._suspect = [slipped], -1
                self._older = self._older._replace(number=0)
        state, covariance = self._corrections(_both(self._older, newest))
        self.heading, self.mountings = float(state[0]), state[1:].reshape(-1, 3)
        left = np.diag(covariance)[1:].reshape(-1, 3).mean(1)
        self.spreads = np.sqrt(left + self._strap**2)
        off = np.linalg.norm(self._seen_part(self.mountings), axis=-1)
        self._looks = self._older.number + newest.number
        self.mistaken = self._far(state, covariance) & (off > TOLD) & (self._looks >= FEWEST_LOOKS)

    def _slip(self, newest: MeanObservation) -> int:
        """Return the device that has slipped according to the recent observations, or -1.

        This is a generalised likelihood ratio test (Willsky and Jones 1976). For each device it estimates the
        change of the mounting that explains the difference between recent and older observations. This change
        has no prior. The test statistic is the change in its standard deviations.
        """
        state, covariance = self._corrections(self._older)
        looks = min(self._config.looks, float(newest.number))
        before = np.linalg.inv(covariance)
        after = np.linalg.inv(before + looks * newest.information)
        drawn = -before @ after @ (looks * (newest.information @ state + newest.pull))
        known = before - before @ after @ before
        blocks, drawn, axes = _own_blocks(known), drawn[1:].reshape(-1, 3), self._unseen
        # rotations about an axis that cameras do not observe are free, and eliminated
        along = (blocks @ axes[..., None])[..., 0]
        share = along / np.maximum((along * axes).sum(-1), UNKNOWN)[:, None]
        blocks = blocks - along[:, :, None] * share[:, None, :] + WIDE**-2 * np.eye(3)
        drawn = drawn - (drawn * axes).sum(-1, keepdims=True) * share
        moved = np.linalg.solve(blocks, drawn[..., None])[..., 0]
        sure = np.sqrt(np.maximum((moved * drawn).sum(-1), 0.0))
        device = int(sure.argmax())
        return device if sure[device] > SLIPPED_SDS else -1

    def _corrections(self, found: MeanObservation) -> tuple[Array, Array]:
        """Return the most likely state and its covariance."""
        information, pull, _ = found
        looks = min(self._config.looks, float(found.number))
        stated = math.radians(self._config.mounting_sd)
        count = len(self._segments)
        # first with a wide prior: a tight one would hold a mistake back before it is detected
        state, covariance = self._solved(information, pull, looks, (self._heading_sd, np.full(count, WIDE)))
        far = self._far(state, covariance)
        heading_sd, own = self._heading_sd, np.where(far, MOST_SD, self._common)
        for _ in range(ROUNDS):
            state, covariance = self._solved(information, pull, looks, (heading_sd, own))
            turned2 = HEADING_TRUST * self._heading_sd**2 + state[0] ** 2 + covariance[0, 0]
            if self._several:
                heading_sd = math.sqrt(turned2 / (HEADING_TRUST + 1.0))
            squares = (state[1:].reshape(-1, 3) ** 2).sum(1) / 3.0
            squares += np.diag(covariance)[1:].reshape(-1, 3).mean(1)
            typical = float(np.median(squares))
            common2 = (COMMON_TRUST * stated**2 + count * typical) / (COMMON_TRUST + count)
            self._common = math.sqrt(common2)
            own = np.sqrt((DEVICE_TRUST * common2 + 3.0 * squares) / (DEVICE_TRUST + 3.0))
            own = np.where(far, MOST_SD, np.minimum(own, MOST_SD))
        return state, covariance

    def _far(self, state: Array, covariance: Array) -> Array:
        """Return a mask (N,) of the devices with a wrong mounting.

        The error of a wrong mounting exceeds both the usual errors of this person's devices and the
        uncertainty of the estimate from the cameras.
        """
        off = np.linalg.norm(self._seen_part(state[1:].reshape(-1, 3)), axis=-1)
        blocks, axes = _own_blocks(covariance), self._unseen
        unseen = ((blocks @ axes[..., None])[..., 0] * axes).sum(-1)
        unsure = np.sqrt(np.trace(blocks, axis1=1, axis2=2) - unseen)
        found: Array = off > np.maximum(max(MISTAKEN, MISTAKEN_SDS * self._common), MISTAKEN_SPREADS * unsure)
        return found & self._several

    def _seen_part(self, turns: Array) -> Array:
        """Return rotations (N, 3) of the segments without the part about unobserved axes.

        The prior alone determines that part.
        """
        found: Array = turns - (turns * self._unseen).sum(-1, keepdims=True) * self._unseen
        return found

    @staticmethod
    def _solved(
        information: Array, pull: Array, looks: float, spreads: tuple[float, Array]
    ) -> tuple[Array, Array]:
        """Return state and covariance for given standard deviations of the heading and the mountings (N,)."""
        precision = np.r_[spreads[0] ** -2, np.repeat(spreads[1] ** -2, 3)]
        covariance = inverse_of(looks * information + np.diag(precision))
        return -covariance @ (looks * pull), covariance


def _own_blocks(matrix: Array) -> Array:
    """Return the diagonal blocks (N, 3, 3) of the mountings in a matrix (1 + 3 N, 1 + 3 N)."""
    count = len(matrix) // 3
    found: Array = matrix[1:, 1:].reshape(count, 3, count, 3)[np.arange(count), :, np.arange(count)]
    return found
