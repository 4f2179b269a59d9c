"""What poses look like: a principal component analysis of recorded ones (Malleson et al. 2020, eq. 14,
15)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from panoptic_ros.domain.segments import SegmentModel
from panoptic_ros.errors import DataError
from panoptic_ros.geometry.rotations import rotations_of, vectors_of
from panoptic_ros.kinematics.pose.targets import NO_HINGES, Hinges, PosePrior

Array = np.ndarray
KEPT_VARIANCE = 0.95
LEAST_OFF, OFF_SHARE = np.radians(2.0), 0.06  # rad; share of the range of a joint
APART = 0.35  # rad, distance of poses that are kept for training: no pose counts by how often it occurs


@dataclass(frozen=True, eq=False)
class PoseStatistics:
    """Mean (N,) of the rotation vectors of all segments but the root, components (N, K) and their standard
    deviations (K,), rad; and the deviation of each axis of each segment (N,), rad."""

    mean: Array
    components: Array
    deviations: Array
    spreads: Array

    @property
    def projection(self) -> Array:
        """(N, N), squared distance from the space of the components."""
        n = len(self.mean)
        found: Array = np.eye(n) - self.components @ self.components.T
        return found

    @property
    def deviation(self) -> Array:
        """(N, N), squared distance from the mean inside of that space, in standard deviations."""
        scaled = self.components / self.deviations
        found: Array = scaled @ scaled.T
        return found

    def of_other_segments(self, own: Sequence[str], names: Sequence[str]) -> PoseStatistics:
        """Statistics of another skeleton whose segments are called alike; those of no segment here lie near
        the T posture.

        Args:
            own, names: of the segments here and there, the roots first.

        Raises:
            DataError: if the statistics are not of these segments, or none is called alike.
        """
        if 3 * len(own) - 3 != len(self.mean):
            raise DataError(f"statistics of {len(self.mean)} axes are not of {len(own)} segments")
        if tuple(own) == tuple(names):
            return self
        there = [k for k, name in enumerate(names[1:]) if name in own[1:]]
        if not there:
            raise DataError(f"none of its segments is one of {', '.join(names[1:])}")
        rows = _axes([list(own[1:]).index(names[1 + k]) for k in there])
        mine, count = _axes(there), 3 * len(names) - 3
        mean, spreads, covariance = np.zeros(count), np.full(count, np.pi), np.zeros((count, count))
        mean[mine], spreads[mine] = self.mean[rows], self.spreads[rows]
        scaled = self.components[rows] * self.deviations
        covariance[np.ix_(mine, mine)] = scaled @ scaled.T
        variances, components = np.linalg.eigh(covariance)
        kept = np.flatnonzero(variances > LEAST_OFF**2)[::-1]
        return PoseStatistics(
            mean, np.ascontiguousarray(components[:, kept]), np.sqrt(variances[kept]), spreads
        )

    def measured_in(self, spreads: Array) -> tuple[Array, Array]:
        """Projection and deviation where axes are off the space by spreads (N,), rad, of their own: of the
        distances from the space in these spreads, and of its point that is nearest by them."""
        weights = spreads**-2
        inverse = np.linalg.inv(self.components.T @ (weights[:, None] * self.components))
        along = inverse @ (self.components.T * weights)
        scaled = along / self.deviations[:, None]
        projection = np.diag(weights) - (weights[:, None] * self.components) @ along
        return np.ascontiguousarray(projection), np.ascontiguousarray(scaled.T @ scaled)

    def off_space(self, lower: Array, upper: Array, most: float) -> Array:
        """How far (N,), rad, poses that were not recorded lie off the space, per axis: about as
        far as recorded ones deviate, and no less than a share of what the joint can turn, as recordings of
        joints tell little of turns about bones.

        Args:
            lower, upper: (S, 3) rad, limits. most: rad, that counts of what they deviate.
        """
        seen = LEAST_OFF**2 + 1.0 / (np.maximum(self.spreads, 1e-6) ** -2 + most**-2)
        found: Array = np.maximum(np.sqrt(seen), OFF_SHARE * (upper - lower)[1:].ravel())
        return found

    def prior(self, lower: Array, upper: Array, costs: PriorCosts) -> PosePrior:
        """For the solver.

        Args:
            lower, upper: (S, 3) limits, see `SegmentModel`.
        """
        projection, deviation = self.projection, self.deviation
        if costs.off_space:
            projection, deviation = self.measured_in(self.off_space(lower, upper, costs.off_space))
        return PosePrior(
            self.mean,
            projection,
            deviation,
            np.ascontiguousarray(lower[1:].ravel()),
            np.ascontiguousarray(upper[1:].ravel()),
            costs.projection,
            costs.projection_scale,
            costs.deviation,
            costs.deviation_scale,
            costs.limits,
            NO_HINGES,
        )


@dataclass(frozen=True)
class PriorCosts:
    """Weights and scales of the terms, see `targets.PosePrior`; `off_space`, rad: axes are off the space of
    the components by distances of their own, at most about this; 0 = all by the same."""

    projection: float
    projection_scale: float
    deviation: float
    deviation_scale: float
    limits: float
    off_space: float = 0.0


def _axes(segments: Sequence[int]) -> Array:
    """Rows (3 N,) of the axes of segments."""
    found: Array = (3 * np.array(segments, np.int64)[:, None] + np.arange(3)).ravel()
    return found


def hinges_of(model: SegmentModel, spread: float) -> Hinges:
    """The hinges of a skeleton; bones lead to the next joint.

    Args:
        spread: rad, how far bones leave the plane in which they bend.
    """
    segments = np.array([model.index(name) for name in model.hinges], np.int64)
    axes = np.array([np.eye(3)["xyz".index(axis)] for axis in model.hinges.values()]).reshape(-1, 3)
    ends = [int(np.flatnonzero(model.parents == s)[0]) for s in segments]
    bones = model.shares[ends] / np.linalg.norm(model.shares[ends], axis=-1, keepdims=True)
    return Hinges(segments, axes, bones.reshape(-1, 3), spread**-2)


def train_prior(vectors: Array, mirrored: Array, apart: float = APART) -> PoseStatistics:
    """Statistics of poses, and of the same poses mirrored.

    Args:
        vectors: (T, S, 3) rotation vectors, the root's first, which is not used.
        mirrored: (S,) index of the segment on the other side.

    Raises:
        DataError: if all poses are alike, as of somebody who stands still.
    """
    poses = np.concatenate([vectors, mirror(vectors, mirrored)])[:, 1:]
    flat = poses.reshape(len(poses), -1)
    kept = _thinned(flat, apart)
    if len(kept) < 2:
        raise DataError(f"{len(vectors)} poses are alike within {apart:g} rad; a prior is trained on motion")
    mean = kept.mean(0)
    _, singular, axes = np.linalg.svd(kept - mean, full_matrices=False)
    variance = singular**2 / max(len(kept) - 1, 1)
    count = int(np.searchsorted(np.cumsum(variance) / variance.sum(), KEPT_VARIANCE)) + 1
    return PoseStatistics(mean, np.ascontiguousarray(axes[:count].T), np.sqrt(variance[:count]), kept.std(0))


def mirror(vectors: Array, mirrored: Array) -> Array:
    """Poses (T, S, 3) with left and right exchanged: a rotation vector (x, y, z) becomes (-x, y, -z)."""
    found: Array = vectors[:, mirrored] * np.array([-1.0, 1.0, -1.0])
    return found


def other_sides(names: tuple[str, ...]) -> Array:
    """Index (S,) of the segment on the other side: lX of rX; of all others, of itself."""
    other = {"l": "r", "r": "l"}
    swapped = [other.get(name[0], "") + name[1:] for name in names]
    return np.array([names.index(s) if s in names else k for k, s in enumerate(swapped)])


def shortest(vectors: Array) -> Array:
    """The same rotations (T, S, 3) with vectors of at most pi."""
    found: Array = vectors_of(rotations_of(vectors.reshape(-1, 3))).reshape(vectors.shape)
    return found


def _thinned(poses: Array, apart: float) -> Array:
    """Poses (K, N) of which no two are nearer than `apart`, in their order."""
    kept = np.empty_like(poses)
    count = 0
    for pose in poses:
        if not count or ((kept[:count] - pose) ** 2).sum(1).min() > apart * apart:
            kept[count] = pose
            count += 1
    return kept[:count]
