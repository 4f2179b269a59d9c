"""Statistical prior of poses: a principal component analysis of recorded poses.

Source: Malleson et al. 2020, eq. 14 and 15.
"""

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
# rad, and fraction of a joint's range: least deviations from the component space
LEAST_OFF, OFF_SHARE = np.radians(2.0), 0.06
APART = 0.35  # rad, least distance between training poses: frequent poses do not count more than rare ones


@dataclass(frozen=True, eq=False)
class PoseStatistics:
    """Statistics of the rotation vectors of all segments except the root, N = 3 S - 3 axes.

    Attributes:
        mean: (N,) rad.
        components, deviations: (N, K) principal components and (K,) rad, standard deviations along them.
        spreads: (N,) rad, standard deviation of each axis of each segment.
    """

    mean: Array
    components: Array
    deviations: Array
    spreads: Array

    @property
    def projection(self) -> Array:
        """Return the matrix (N, N) of the squared distance from the space of the components."""
        n = len(self.mean)
        found: Array = np.eye(n) - self.components @ self.components.T
        return found

    @property
    def deviation(self) -> Array:
        """Return the matrix (N, N) of the squared distance from the mean in that space.

        Distances are in standard deviations.
        """
        scaled = self.components / self.deviations
        found: Array = scaled @ scaled.T
        return found

    def of_other_segments(self, own: Sequence[str], names: Sequence[str]) -> PoseStatistics:
        """Return the statistics of another skeleton, with segments matched by name.

        Segments that have no counterpart here get the T posture as mean, with a spread of pi per axis.

        Args:
            own, names: Names of the segments here and of the other skeleton, the roots first.

        Raises:
            DataError: If the statistics are not of the segments `own`, or no name matches.
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
        """Return projection and deviation matrices for axes that leave the space by different amounts.

        Args:
            spreads: (N,) rad, standard deviation of each axis from the space of the components.

        Returns:
            The matrix (N, N) of the squared distance from the space, in these spreads. The matrix (N, N) of
            the squared deviation, in standard deviations, of the point of the space that is nearest in this
            metric.
        """
        weights = spreads**-2
        inverse = np.linalg.inv(self.components.T @ (weights[:, None] * self.components))
        along = inverse @ (self.components.T * weights)
        scaled = along / self.deviations[:, None]
        projection = np.diag(weights) - (weights[:, None] * self.components) @ along
        return np.ascontiguousarray(projection), np.ascontiguousarray(scaled.T @ scaled)

    def off_space(self, lower: Array, upper: Array, most: float) -> Array:
        """Return the standard deviation (N,) rad of unrecorded poses from the component space, per axis.

        It is about the recorded spread of the axis. It is at least a fraction of the joint's range, because
        recordings of joints show little of rotations about bones.

        Args:
            lower, upper: (S, 3) rad, joint limits.
            most: rad, about the upper limit of the part that comes from the recorded spread.
        """
        seen = LEAST_OFF**2 + 1.0 / (np.maximum(self.spreads, 1e-6) ** -2 + most**-2)
        found: Array = np.maximum(np.sqrt(seen), OFF_SHARE * (upper - lower)[1:].ravel())
        return found

    def prior(self, lower: Array, upper: Array, costs: PriorCosts) -> PosePrior:
        """Return the prior in the form that the solver takes.

        Args:
            lower, upper: (S, 3) rad, joint limits, see `SegmentModel`.
            costs: Weights and scales of its terms.
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
    """Weights and scales of the terms of `targets.PosePrior`.

    Attributes:
        off_space: rad, about the largest standard deviation of an axis from the space of the components. Each
            axis has its own, see `PoseStatistics.off_space`. 0 = the same for all axes.
    """

    projection: float
    projection_scale: float
    deviation: float
    deviation_scale: float
    limits: float
    off_space: float = 0.0


def _axes(segments: Sequence[int]) -> Array:
    """Return the indices (3 N,) of the axes of N segments."""
    found: Array = (3 * np.array(segments, np.int64)[:, None] + np.arange(3)).ravel()
    return found


def hinges_of(model: SegmentModel, spread: float) -> Hinges:
    """Return the hinges of a skeleton. The bone of a hinge leads to the next joint.

    Args:
        spread: rad, standard deviation of bones from the plane in which they bend.
    """
    segments = np.array([model.index(name) for name in model.hinges], np.int64)
    axes = np.array([np.eye(3)["xyz".index(axis)] for axis in model.hinges.values()]).reshape(-1, 3)
    ends = [int(np.flatnonzero(model.parents == s)[0]) for s in segments]
    bones = model.shares[ends] / np.linalg.norm(model.shares[ends], axis=-1, keepdims=True)
    return Hinges(segments, axes, bones.reshape(-1, 3), spread**-2)


def train_prior(vectors: Array, mirrored: Array, apart: float = APART) -> PoseStatistics:
    """Return the statistics of poses together with their mirror images.

    Args:
        vectors: (T, S, 3) rotation vectors, rad. The root comes first and is not used.
        mirrored: (S,) index of the segment on the other side.
        apart: rad, least distance between poses that are kept.

    Raises:
        DataError: If all poses are alike, such as those of a person who stands still.
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
    """Return poses (T, S, 3) with left and right exchanged.

    A rotation vector (x, y, z) becomes (-x, y, -z).
    """
    found: Array = vectors[:, mirrored] * np.array([-1.0, 1.0, -1.0])
    return found


def other_sides(names: tuple[str, ...]) -> Array:
    """Return the index (S,) of each segment's counterpart on the other side.

    Names lX and rX are counterparts. All other segments map to themselves.
    """
    other = {"l": "r", "r": "l"}
    swapped = [other.get(name[0], "") + name[1:] for name in names]
    return np.array([names.index(s) if s in names else k for k, s in enumerate(swapped)])


def shortest(vectors: Array) -> Array:
    """Return the same rotations (T, S, 3) as vectors of length pi at most."""
    found: Array = vectors_of(rotations_of(vectors.reshape(-1, 3))).reshape(vectors.shape)
    return found


def _thinned(poses: Array, apart: float) -> Array:
    """Return poses (K, N), in their order, of which no two are nearer than `apart`."""
    kept = np.empty_like(poses)
    count = 0
    for pose in poses:
        if not count or ((kept[:count] - pose) ** 2).sum(1).min() > apart * apart:
            kept[count] = pose
            count += 1
    return kept[:count]
