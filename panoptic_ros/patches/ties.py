"""Parts hang together: a limb moves at its joint as the part that carries it does.

The motion of every limb is corrected by that of the part above it, from the torso outwards: the displacement
of the shared joint is a measurement of the limb's motion, with the covariance of the other's. Where the two
contradict each other, both know less than they say, and the limb's covariance grows (the ratio of Birge
1932).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from panoptic_ros.domain.parts import Part
from panoptic_ros.geometry.rotations import rotation_of

Array = np.ndarray
TIE_SIGMA = 0.003  # m, by which two parts move unlike at a joint: where it is, is known roughly


class Ties:
    """Which part carries which, and at which joint."""

    def __init__(self, parts: tuple[Part, ...]):
        torso = next((k for k, part in enumerate(parts) if part.name == "torso"), -1)
        self.of: list[tuple[int, int, int]] = []  # part above, part, joint; from the torso outwards
        for k, part in enumerate(parts):
            if part.is_limb and torso >= 0 and part.joints[0] in parts[torso].joints:
                self.of.append((torso, k, part.joints[0]))
        for above, k, _ in tuple(self.of):
            for other, part in enumerate(parts):
                if part.is_limb and part.joints[0] == parts[k].joints[1] and other != above:
                    self.of.append((k, other, part.joints[0]))

    def correct(
        self, rows: Mapping[int, int], joints: Array, centres: Array, motions: Array, covariances: Array
    ) -> None:
        """Correct the motions (M, 6) of one person's parts and their covariances (M, 6, 6), in place.

        Args:
            rows: of the parts that have a motion. joints: (J, 3) m, before; NaN = not known.
            centres: (M, 3) m of the motions.
        """
        for above, part, joint in self.of:
            if above not in rows or part not in rows or not np.isfinite(joints[joint, 0]):
                continue
            first, other = rows[above], rows[part]
            place, joint_above = _at(joints[joint], centres[first], motions[first])
            own, joint_own = _at(joints[joint], centres[other], motions[other])
            spread = joint_above @ covariances[first] @ joint_above.T + TIE_SIGMA**2 * np.eye(3)
            total = joint_own @ covariances[other] @ joint_own.T + spread
            off = place - own
            birge = max(1.0, float(off @ np.linalg.solve(total, off)) / 3.0)
            gain = covariances[other] @ joint_own.T @ np.linalg.inv(total)
            step = gain @ off
            motions[other] = _composed(motions[other], step)
            covariances[other] = birge * (covariances[other] - gain @ joint_own @ covariances[other])


def _at(joint: Array, centre: Array, motion: Array) -> tuple[Array, Array]:
    """Displacement (3,) m of a joint (3,) m, its derivative (3, 6) by a rotation (left) and a shift."""
    rotation = np.empty((3, 3))
    rotation_of(motion[:3], rotation)
    arm = rotation @ (joint - centre)
    jacobian = np.hstack([-np.cross(np.eye(3), arm), np.eye(3)])
    return centre + arm + motion[3:] - joint, jacobian


def _composed(motion: Array, step: Array) -> Array:
    """A motion (6,) and then a small one (6,)."""
    # to first order in the step, which is far below a tenth of a radian
    half = step[:3] + 0.5 * np.cross(step[:3], motion[:3])
    return np.concatenate([motion[:3] + half, motion[3:] + step[3:]])
