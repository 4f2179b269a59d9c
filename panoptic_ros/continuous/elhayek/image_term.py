"""Similarity of a body of blobs to images, each image at its own timestamp (paper, 4.1 and 4.2).

All lengths are on the normalised image plane, so the focal length of equation 4 is 1.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from panoptic_ros.continuous.elhayek.body_blobs import SIGMA, BodyBlobs, TimedBlobs
from panoptic_ros.continuous.elhayek.energy import PoseSums, PoseTerm
from panoptic_ros.continuous.elhayek.polynomials import wendland
from panoptic_ros.continuous.elhayek.quad_tree import ImageBlobs
from panoptic_ros.continuous.elhayek.skeleton import HingeSkeleton
from panoptic_ros.continuous.problem import LEAST_DEPTH
from panoptic_ros.domain.rig_arrays import RigArrays

Array = np.ndarray
COLOUR_REACH = 0.4  # distance in the HSV cylinder (radius 1, height 1) from which colours count as different
NEAR = 0.3  # m, distance from the body at the start of a fit, up to which image blobs take part
SIGMAS = 2.0  # further distance, in standard deviations of both blobs
SIMILAR = 1e-3  # least colour similarity of an image blob to a model blob
LEAST_TOTAL = 1e-12  # self-similarity of an image that does not show the body
# Information of one image, in units of the second derivatives of its similarity. Its error is mostly bias, of
# which these know nothing. The value gives the mean error of two rendered captures.
PRECISION = 200.0


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
    """

    value: float
    by_means: Array
    by_sigmas: Array
    curvatures: Array


def similarity(
    image: ImageBlobs, weights: Array, means: Array, sigmas: Array, pairs: BlobPairs
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
    )


class ImageTerm:
    """Negative mean similarity of a person to images (a `PoseTerm`), equation 7 of the paper.

    The image of the equation is its part near the person: the rest is constant.

    Args:
        images: of one segment, at least one, ordered by time.
        poses: (T, D) approximate poses at their times.
    """

    def __init__(
        self,
        images: Sequence[TimedBlobs],
        poses: Array,
        body: BodyBlobs,
        skeleton: HingeSkeleton,
        arrays: RigArrays,
    ):
        self._body, self._skeleton = body, skeleton
        cameras = [image.camera for image in images]
        self.times = np.array([image.time for image in images])
        self._rotations, self._translations = arrays.rotations[cameras], arrays.translations[cameras]
        means, sigmas, _ = self._projected(skeleton.place(poses).points(body.segments, body.offsets))
        parts = [_near_body(image.blobs, *one, body) for image, one in zip(images, zip(means, sigmas))]
        blobs, pairs, weights = zip(*parts)
        first = np.cumsum([0, *(len(own.sigmas) for own in blobs)])
        self._blobs = ImageBlobs(*(np.concatenate(column).astype(np.float64) for column in zip(*blobs)))
        self._weights = np.concatenate(weights) / len(images)
        self._pairs = BlobPairs(
            np.concatenate([start + own.image for start, own in zip(first, pairs)]),
            np.concatenate([t * len(body.radii) + own.model for t, own in enumerate(pairs)]),
            np.concatenate([own.similar for own in pairs]),
        )

    def sums(self, freedoms: Array) -> PoseSums:
        """Return the energy of degrees of freedom (T, D)."""
        points, slopes = self._skeleton.moved(freedoms, self._body.segments, self._body.offsets)
        means, sigmas, depths = self._projected(points)
        found = similarity(self._blobs, self._weights, means.reshape(-1, 2), sigmas.ravel(), self._pairs)
        slopes = self._rotations[:, None] @ slopes  # in the cameras' frames
        of_means = (slopes[..., :2, :] - means[..., None] * slopes[..., 2:, :]) / depths[..., None, None]
        of_sigmas = -slopes[..., 2, :] * (sigmas / depths)[..., None]
        gradients = np.einsum("tne,tned->td", found.by_means.reshape(means.shape), of_means)
        gradients += np.einsum("tn,tnd->td", found.by_sigmas.reshape(sigmas.shape), of_sigmas)
        weighted = of_means * found.curvatures.reshape(*sigmas.shape, 1, 1)
        flat = (len(freedoms), -1, freedoms.shape[1])
        matrices = weighted.reshape(flat).swapaxes(1, 2) @ of_means.reshape(flat)
        return PoseSums(-found.value, -gradients, matrices)

    def precision(self, freedoms: Array, spent: int) -> float:
        """Return the factor from the matrices of `sums` to the information of the images."""
        return PRECISION * len(self.times)

    def _projected(self, points: Array) -> tuple[Array, Array, Array]:
        """Return blobs at world points (T, N, 3) m in the images, equation 4 of the paper.

        Returns:
            means (T, N, 2) and standard deviations (T, N) on the image planes, and depths (T, N) m.
        """
        local = points @ self._rotations.swapaxes(1, 2) + self._translations[:, None]
        depths = np.maximum(local[..., 2], LEAST_DEPTH)
        return local[..., :2] / depths[..., None], SIGMA * self._body.radii / depths, depths


def _near_body(
    image: ImageBlobs, means: Array, sigmas: Array, body: BodyBlobs
) -> tuple[ImageBlobs, BlobPairs, Array]:
    """Return the image blobs near a body that resemble it, their pairs with model blobs, and their weights.

    The weight is 1 over the self-similarity of all image blobs near the body.

    Args:
        means, sigmas: (N, 2) and (N,) of the projected model blobs.
    """
    reach = NEAR * float(np.median(sigmas / body.radii)) / SIGMA
    inside = (image.means > means.min(axis=0) - reach) & (image.means < means.max(axis=0) + reach)
    near = ImageBlobs(*(part[inside.all(axis=1)] for part in image))
    total = max(np.pi * float((near.sigmas**2).sum()), LEAST_TOTAL)
    colours = np.linalg.norm(near.colours[:, None] - body.colours[None], axis=-1)
    similar = wendland(colours / COLOUR_REACH)
    gaps = np.linalg.norm(near.means[:, None] - means[None], axis=-1)
    together = (similar > SIMILAR) & (gaps < reach + SIGMAS * np.hypot(near.sigmas[:, None], sigmas[None]))
    alike = together.any(axis=1)
    chosen, model = np.nonzero(together[alike])
    pairs = BlobPairs(chosen, model, similar[alike][chosen, model])
    return ImageBlobs(*(part[alike] for part in near)), pairs, np.full(int(alike.sum()), 1.0 / total)


class ImageMeasurements:
    """Images of a person as `tracking.Measurements`.

    Args:
        images: of the whole recording, ordered by time.
        body: at least one blob.
    """

    fits = 2  # the second one chooses the image blobs near the result of the first one

    def __init__(
        self, images: Sequence[TimedBlobs], body: BodyBlobs, skeleton: HingeSkeleton, arrays: RigArrays
    ):
        self._images, self._body, self._skeleton, self._arrays = images, body, skeleton, arrays
        self._times = np.array([image.time for image in images])

    def term(self, fit: int, segment: Array, poses: Callable[[Array], Array]) -> PoseTerm | None:
        """Return the term of a fit of a segment (2,) s, None = no image lies in it."""
        own = slice(*np.searchsorted(self._times, segment))
        images = self._images[own]
        if not images:
            return None
        return ImageTerm(images, poses(self._times[own]), self._body, self._skeleton, self._arrays)
