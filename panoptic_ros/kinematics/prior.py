"""What poses look like: a principal component analysis of recorded ones (Malleson et al. 2020, eq. 14,
15)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from panoptic_ros.geometry.rotations import rotations_of, vectors_of
from panoptic_ros.kinematics.targets import PosePrior

Array = np.ndarray
KEPT_VARIANCE = 0.95
APART = 0.35  # rad, distance of poses that are kept for training: no pose counts by how often it occurs


@dataclass(frozen=True, eq=False)
class PoseStatistics:
    """Mean (N,) of the rotation vectors of all segments but the root, components (N, K) and their standard
    deviations (K,), rad."""

    mean: Array
    components: Array
    deviations: Array

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

    def prior(self, lower: Array, upper: Array, costs: PriorCosts) -> PosePrior:
        """For the solver.

        Args:
            lower, upper: (S, 3) limits, see `SegmentModel`.
        """
        return PosePrior(
            self.mean, self.projection, self.deviation, np.ascontiguousarray(lower[1:].ravel()),
            np.ascontiguousarray(upper[1:].ravel()), costs.projection, costs.projection_scale,
            costs.deviation, costs.deviation_scale, costs.limits,
        )  # fmt: skip


@dataclass(frozen=True)
class PriorCosts:
    """Weights and scales of the terms, see `targets.PosePrior`."""

    projection: float
    projection_scale: float
    deviation: float
    deviation_scale: float
    limits: float


def train_prior(vectors: Array, mirrored: Array, apart: float = APART) -> PoseStatistics:
    """Statistics of poses, and of the same poses mirrored.

    Args:
        vectors: (T, S, 3) rotation vectors, the root's first, which is not used.
        mirrored: (S,) index of the segment on the other side.
    """
    poses = np.concatenate([vectors, mirror(vectors, mirrored)])[:, 1:]
    flat = poses.reshape(len(poses), -1)
    kept = _thinned(flat, apart)
    mean = kept.mean(0)
    _, singular, axes = np.linalg.svd(kept - mean, full_matrices=False)
    variance = singular**2 / max(len(kept) - 1, 1)
    count = int(np.searchsorted(np.cumsum(variance) / variance.sum(), KEPT_VARIANCE)) + 1
    return PoseStatistics(mean, np.ascontiguousarray(axes[:count].T), np.sqrt(variance[:count]))


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
