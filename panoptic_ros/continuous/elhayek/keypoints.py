"""Similarity of the skeleton to 2D joints, each view at its own timestamp.

A 2D joint counts as an image blob of one joint alone: a Gaussian on the image plane. So this term has the
form of the paper's image term, and its derivative fades for a wrong 2D joint.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from panoptic_ros.continuous.elhayek.energy import PoseSums, PoseTerm
from panoptic_ros.continuous.elhayek.skeleton import HingeSkeleton
from panoptic_ros.continuous.person import PersonCurve
from panoptic_ros.continuous.problem import FIRST_NOISE, LEAST_DEPTH
from panoptic_ros.domain.rig_arrays import RigArrays
from panoptic_ros.solving.joint_noise import JointNoiseModel

Array = np.ndarray
# Standard deviations of the Gaussians, in units of the noise of a 2D joint: wide enough for the error of an
# extrapolation at first. The last one has the efficiency of Cauchy weights with 3.
WIDTHS = (60.0, 15.0, 3.0)
LEAST_LEFT = 0.1  # minimum share of the misses that counts as noise and not as fitted


@dataclass(frozen=True, eq=False)
class Keypoints:
    """N 2D joints of one person, ordered by time.

    Args:
        times: (N,) s.
        joints: (N,) index of the detector's joint.
        rows, rights: (N, 2, 3) and (N, 2), see `curves.WeightedRays`.
        depth_rows, depth_offsets: (N, 3) and (N,); the depth is depth_rows @ X + depth_offsets.
        sigmas: (N,) standard deviation on the normalised image plane.
    """

    times: Array
    joints: Array
    rows: Array
    rights: Array
    depth_rows: Array
    depth_offsets: Array
    sigmas: Array

    @classmethod
    def of(cls, person: PersonCurve, arrays: RigArrays) -> Keypoints:
        """Return the 2D joints of a person. Their noise follows from residuals of its joint curves."""
        rays, order = person.rays, np.argsort(person.times, kind="stable")
        cameras = rays.cameras[order]
        found = cls(
            person.times[order],
            rays.joints[order],
            rays.rows[order],
            rays.rights[order],
            arrays.rotations[cameras, 2],
            arrays.translations[cameras, 2],
            np.ones(len(order)),
        )
        noise = JointNoiseModel(cameras, found.joints, rays.scores[order], FIRST_NOISE)
        misses, _ = found.misses(person.at(found.times)[np.arange(len(order)), found.joints])
        ratios = np.linalg.norm(misses, axis=1) / FIRST_NOISE
        noise.learn(ratios, np.isfinite(ratios))
        found.sigmas[:] = noise.sigmas()
        return found

    def chosen(self, which: Array | slice) -> Keypoints:
        """Return some of the 2D joints."""
        return Keypoints(*(getattr(self, name)[which] for name in self.__dataclass_fields__))

    def misses(self, points: Array) -> tuple[Array, Array]:
        """Return the misses (N, 2) of points (N, 3) m in units of the noise, and their depths (N,) m."""
        depths = np.einsum("ni,ni->n", self.depth_rows, points) + self.depth_offsets
        depths = np.maximum(depths, LEAST_DEPTH)
        misses = np.einsum("nij,nj->ni", self.rows, points) - self.rights
        return misses / (depths * self.sigmas)[:, None], depths


class KeypointTerm:
    """Negative mean similarity of the skeleton to 2D joints (a `PoseTerm`).

    Args:
        keypoints: at least one.
        width: standard deviation of the Gaussians, in units of the noise.
    """

    def __init__(self, keypoints: Keypoints, skeleton: HingeSkeleton, width: float):
        self._keypoints, self._skeleton, self._width = keypoints, skeleton, width
        self.times, self._starts, self._at = np.unique(
            keypoints.times, return_index=True, return_inverse=True
        )

    def sums(self, freedoms: Array) -> PoseSums:
        """Return the energy of degrees of freedom (T, D)."""
        misses, slopes = self._residuals(freedoms)
        similar = np.exp(-0.5 * (misses**2).sum(1) / self._width**2) / len(misses)
        weighted = slopes * (similar / self._width**2)[:, None, None]
        gradients = np.einsum("ned,ne->nd", weighted, misses)
        matrices = weighted.swapaxes(1, 2) @ slopes
        return PoseSums(
            -float(similar.sum()),
            np.add.reduceat(gradients, self._starts),
            np.add.reduceat(matrices, self._starts),
        )

    def precision(self, freedoms: Array, spent: int) -> float:
        """Return the factor from the matrices of `sums` to the information of the 2D joints.

        Misses beyond the noise, which the polynomials cannot follow, count as noise.
        """
        squares = (self._residuals(freedoms)[0] ** 2).sum(1)
        weights = np.exp(-0.5 * squares / self._width**2)
        left = max(2.0 * weights.sum() - spent, LEAST_LEFT * len(squares))
        return float(len(squares) * self._width**2 / max(weights @ squares / left, 1.0))

    def _residuals(self, freedoms: Array) -> tuple[Array, Array]:
        """Return the misses (N, 2) in units of the noise, and their derivatives (N, 2, D)."""
        data, skeleton = self._keypoints, self._skeleton
        sites, slopes = skeleton.moved(freedoms, skeleton.site_segments, skeleton.site_offsets)
        misses, depths = data.misses(sites[self._at, data.joints])
        scaled = data.rows / data.sigmas[:, None, None] - misses[:, :, None] * data.depth_rows[:, None]
        of_place = scaled / depths[:, None, None]
        return misses, of_place @ slopes[self._at, data.joints]


class KeypointMeasurements:
    """2D joints of a person as `tracking.Measurements`: narrower Gaussians in each fit of a segment."""

    fits = len(WIDTHS)

    def __init__(self, keypoints: Keypoints, skeleton: HingeSkeleton):
        self._keypoints = keypoints.chosen(np.isin(keypoints.joints, skeleton.seen))
        self._skeleton = skeleton

    def term(self, fit: int, segment: Array, poses: Callable[[Array], Array]) -> PoseTerm | None:
        """Return the term of a fit of a segment (2,) s, None = no 2D joint lies in it."""
        own = self._keypoints.chosen(slice(*np.searchsorted(self._keypoints.times, segment)))
        return KeypointTerm(own, self._skeleton, WIDTHS[fit]) if len(own.times) else None
