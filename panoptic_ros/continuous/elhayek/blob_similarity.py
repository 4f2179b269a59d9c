"""Similarity of blobs on a skeleton to blobs of images, with derivatives by its pose (paper, 4.1 and 4.2).

All lengths are on the normalised image plane, so the focal length of equation 4 is 1.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.continuous.elhayek.energy import PoseSums
from panoptic_ros.continuous.elhayek.skeleton import HingeSkeleton
from panoptic_ros.continuous.problem import LEAST_DEPTH
from panoptic_ros.domain.rig_arrays import RigArrays

Array = np.ndarray
NEAR = 0.3  # m, distance from the body at the start of a fit, up to which image blobs take part
SIGMAS = 2.0  # further distance, in standard deviations of both blobs


class PlaneBlobs(NamedTuple):
    """Means (I, 2) and standard deviations (I,) of Gaussians on normalised image planes."""

    means: Array
    sigmas: Array


class BlobPairs(NamedTuple):
    """Q pairs of an image blob and a model blob that may overlap.

    Args:
        image, model: (Q,) indices.
        similar: (Q,) similarity of their colours, d of equation 1 of the paper.
    """

    image: Array
    model: Array
    similar: Array


class BlobSimilarity(NamedTuple):
    """Similarity of N model blobs to image blobs, with derivatives.

    Args:
        value: equation 5 of the paper, weighted.
        by_means: (N, 2) derivatives by the means of the model blobs.
        by_sigmas: (N,) derivatives by their standard deviations.
        curvatures: (N,) curvature, by the means, of the quadratic function that is a lower bound.
        bends: (N,) sum of both second derivatives by the means, negative.
    """

    value: float
    by_means: Array
    by_sigmas: Array
    curvatures: Array
    bends: Array

    def sums(self, of_means: Array) -> PoseSums:
        """Return the energy of poses at T instants, apart from changes of the standard deviations.

        Args:
            of_means: (T, N / T, 2, D) derivatives of the means by the degrees of freedom.
        """
        count, _, _, freedoms = of_means.shape
        gradients = np.einsum("tne,tned->td", self.by_means.reshape(of_means.shape[:3]), of_means)
        weighted = of_means * self.curvatures.reshape(*of_means.shape[:2], 1, 1)
        flat = (count, -1, freedoms)
        matrices = weighted.reshape(flat).swapaxes(1, 2) @ of_means.reshape(flat)
        return PoseSums(-self.value, -gradients, matrices)


def similarity(
    image: PlaneBlobs, weights: Array, means: Array, sigmas: Array, pairs: BlobPairs
) -> BlobSimilarity:
    """Return the similarity of model blobs to image blobs.

    An image blob counts up to its similarity to itself. One that has reached this exerts no force. Equation 3
    of the paper lacks the factor 2 in the exponent. This is the integral that its equation 1 states.

    Args:
        weights: (I,) of the image blobs in the sum.
        means, sigmas: (N, 2) and (N,) of the projected model blobs.
    """
    across, down = (image.means[pairs.image, axis] - means[pairs.model, axis] for axis in range(2))
    own, model = (image.sigmas**2)[pairs.image], (sigmas**2)[pairs.model]
    variances, squares = own + model, across * across + down * down
    values = pairs.similar * (2.0 * np.pi) * own * model / variances * np.exp(-0.5 * squares / variances)
    most = np.pi * image.sigmas**2  # self-similarities
    reached = np.bincount(pairs.image, values, len(most))
    pulls = values * (weights * (reached < most))[pairs.image] / variances
    growths = pulls * (2.0 * own + squares * model / variances) / sigmas[pairs.model]

    def of_model(terms: Array) -> Array:
        return np.bincount(pairs.model, terms, len(means))

    return BlobSimilarity(
        float(weights @ np.minimum(reached, most)),
        np.column_stack([of_model(pulls * across), of_model(pulls * down)]),
        of_model(growths),
        of_model(pulls),
        of_model(pulls * (2.0 - squares / variances)),
    )


class ViewedPoints:
    """N points of a skeleton in T views, each at its own time.

    Args:
        segments, offsets: (N,) and (N, 3) m, segments of the skeleton and places in their frames.
        cameras: (T,) camera of each view.
    """

    def __init__(
        self, skeleton: HingeSkeleton, segments: Array, offsets: Array, cameras: Array, arrays: RigArrays
    ):
        self._skeleton, self._segments, self._offsets = skeleton, segments, offsets
        self._rotations, self._translations = arrays.rotations[cameras], arrays.translations[cameras]

    def at(self, poses: Array) -> tuple[Array, Array]:
        """Return the points at poses (T, D) on the image planes (T, N, 2), and their depths (T, N) m."""
        return self._projected(self._skeleton.place(poses).points(self._segments, self._offsets))

    def moved(self, poses: Array) -> tuple[Array, Array, Array, Array]:
        """Return the result of `at`, and its derivatives (T, N, 2, D) and (T, N, D) by the poses."""
        points, slopes = self._skeleton.moved(poses, self._segments, self._offsets)
        means, depths = self._projected(points)
        slopes = self._rotations[:, None] @ slopes  # in the cameras' frames
        of_means = (slopes[..., :2, :] - means[..., None] * slopes[..., 2:, :]) / depths[..., None, None]
        return means, depths, of_means, slopes[..., 2, :]

    def _projected(self, points: Array) -> tuple[Array, Array]:
        local = points @ self._rotations.swapaxes(1, 2) + self._translations[:, None]
        depths = np.maximum(local[..., 2], LEAST_DEPTH)
        return local[..., :2] / depths[..., None], depths
