"""Similarity of the skeleton to 2D joints, each view at its own timestamp.

A 2D joint counts as an image blob of one joint alone: a Gaussian on the image plane. So this term has the
form of the paper's image term, and its derivative fades for a wrong 2D joint.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from panoptic_ros.continuous.elhayek.energy import PoseSums, PoseTerm
from panoptic_ros.continuous.elhayek.skeleton import Skeleton
from panoptic_ros.continuous.problem import LEAST_DEPTH, PersonRays
from panoptic_ros.domain.rig_arrays import RigArrays

Array = np.ndarray
# standard deviations of the Gaussians, in units of the noise of a 2D joint: wide enough for the error of an
# extrapolation first; the last one has the efficiency of Cauchy weights with 3
WIDTHS = (60.0, 15.0, 3.0)


@dataclass(frozen=True, eq=False)
class Keypoints:
    """N 2D joints of one person, ordered by time.

    Args:
        times: (N,) s.
        joints: (N,) index of the detector's joint.
        rows, rights: (N, 2, 3) and (N, 2), see `curves.Rays`.
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
    def of(
        cls, rays: PersonRays, times: Array, sigmas: Array, arrays: RigArrays, skeleton: Skeleton
    ) -> Keypoints:
        """Return the 2D joints of a person that are part of the skeleton.

        Args:
            times: (N,) s, corrected times of the rays.
            sigmas: (N,) standard deviations on the normalised image plane.
        """
        order = np.argsort(times, kind="stable")
        order = order[np.isin(rays.joints[order], skeleton.seen)]
        cameras = rays.cameras[order]
        return cls(
            times[order],
            rays.joints[order],
            rays.rows[order],
            rays.rights[order],
            arrays.rotations[cameras, 2],
            arrays.translations[cameras, 2],
            sigmas[order],
        )

    def between(self, first: float, last: float) -> Keypoints:
        """Return the 2D joints from `first` to `last` (s)."""
        low, high = np.searchsorted(self.times, (first, last))
        return Keypoints(*(getattr(self, name)[low:high] for name in self.__dataclass_fields__))

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

    def __init__(self, keypoints: Keypoints, skeleton: Skeleton, width: float):
        self._keypoints, self._skeleton, self._width = keypoints, skeleton, width
        self.times, self._starts, self._at = np.unique(
            keypoints.times, return_index=True, return_inverse=True
        )

    def sums(self, freedoms: Array) -> PoseSums:
        """Return the energy of degrees of freedom (T, D)."""
        slopes, misses = self.residuals(freedoms)
        similar = np.exp(-0.5 * (misses**2).sum(1) / self._width**2) / len(misses)
        weights = similar / self._width**2
        gradients = np.einsum("ned,ne,n->nd", slopes, misses, weights)
        weighted = slopes * weights[:, None, None]
        matrices = weighted.swapaxes(1, 2) @ slopes
        return PoseSums(
            -float(similar.sum()),
            np.add.reduceat(gradients, self._starts),
            np.add.reduceat(matrices, self._starts),
        )

    def precision(self, freedoms: Array, spent: int) -> float:
        """Return N c^2 for the width c, over the variance of the misses: what polynomials cannot follow counts."""
        _, misses = self.residuals(freedoms)
        squares = (misses**2).sum(1)
        weights = np.exp(-0.5 * squares / self._width**2)
        left = max(2.0 * weights.sum() - spent, 0.1 * len(misses))
        return len(misses) * self._width**2 / max(float((weights * squares).sum() / left), 1.0)

    def residuals(self, freedoms: Array) -> tuple[Array, Array]:
        """Return misses (N, 2) in units of the noise, and their derivatives (N, 2, D), derivatives first."""
        data, skeleton = self._keypoints, self._skeleton
        placed = skeleton.place(freedoms)
        sites = skeleton.points(placed, skeleton.site_segments, skeleton.site_offsets)
        by_freedom = skeleton.slopes(placed, skeleton.site_segments, sites)[self._at, data.joints]
        misses, depths = data.misses(sites[self._at, data.joints])
        slopes = data.rows @ by_freedom / (depths * data.sigmas)[:, None, None]
        nearer = data.depth_rows[:, None] @ by_freedom / depths[:, None, None]
        return slopes - misses[:, :, None] * nearer, misses


class KeypointMeasurements:
    """2D joints of a person as `tracking.Measurements`: a term per width and segment."""

    fits = len(WIDTHS)

    def __init__(self, keypoints: Keypoints, skeleton: Skeleton):
        self._keypoints, self._skeleton = keypoints, skeleton

    def term(self, fit: int, segment: Array, start: Callable[[Array], Array]) -> PoseTerm | None:
        """Return the term of a fit of a segment (2,) s, None = no 2D joint lies in it."""
        own = self._keypoints.between(*segment)
        return KeypointTerm(own, self._skeleton, WIDTHS[fit]) if len(own.times) else None
