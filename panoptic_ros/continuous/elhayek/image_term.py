"""Similarity of a body of blobs to images, each image at its own timestamp (paper, 4.1 and 4.2)."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from panoptic_ros.continuous.elhayek.blob_similarity import (
    NEAR,
    SIGMAS,
    BlobPairs,
    PlaneBlobs,
    ViewedPoints,
    similarity,
)
from panoptic_ros.continuous.elhayek.body_blobs import SIGMA, BodyBlobs, TimedBlobs
from panoptic_ros.continuous.elhayek.energy import PoseSums, PoseTerm
from panoptic_ros.continuous.elhayek.polynomials import wendland
from panoptic_ros.continuous.elhayek.quad_tree import ImageBlobs
from panoptic_ros.continuous.elhayek.skeleton import HingeSkeleton
from panoptic_ros.domain.rig_arrays import RigArrays

Array = np.ndarray
COLOUR_REACH = 0.4  # distance in the HSV cylinder (radius 1, height 1) from which colours count as different
SIMILAR = 1e-3  # least colour similarity of an image blob to a model blob
LEAST_TOTAL = 1e-12  # self-similarity of an image that does not show the body
# Information of one image, in units of the second derivatives of its similarity. Its error is mostly bias, of
# which these know nothing. The value gives the mean error of two rendered captures.
PRECISION = 200.0


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
        self._body = body
        cameras = np.array([image.camera for image in images])
        self.times = np.array([image.time for image in images])
        self._points = ViewedPoints(skeleton, body.segments, body.offsets, cameras, arrays)
        means, depths = self._points.at(poses)
        sigmas = SIGMA * body.radii / depths
        parts = [_near_body(image.blobs, *one, body) for image, one in zip(images, zip(means, sigmas))]
        blobs, pairs, weights = zip(*parts)
        first = np.cumsum([0, *(len(own.sigmas) for own in blobs)])
        self._blobs = PlaneBlobs(
            np.concatenate([own.means for own in blobs]).astype(np.float64),
            np.concatenate([own.sigmas for own in blobs]).astype(np.float64),
        )
        self._weights = np.concatenate(weights) / len(images)
        self._pairs = BlobPairs(
            np.concatenate([start + own.image for start, own in zip(first, pairs)]),
            np.concatenate([t * len(body.radii) + own.model for t, own in enumerate(pairs)]),
            np.concatenate([own.similar for own in pairs]),
        )

    def sums(self, freedoms: Array) -> PoseSums:
        """Return the energy of degrees of freedom (T, D)."""
        means, depths, of_means, of_depths = self._points.moved(freedoms)
        sigmas = SIGMA * self._body.radii / depths
        found = similarity(self._blobs, self._weights, means.reshape(-1, 2), sigmas.ravel(), self._pairs)
        sums = found.sums(of_means)
        shrinking = of_depths * (sigmas / depths)[..., None]  # minus the derivatives of the sigmas
        growths = found.by_sigmas.reshape(sigmas.shape)
        return sums._replace(gradients=sums.gradients + np.einsum("tn,tnd->td", growths, shrinking))

    def precision(self, freedoms: Array, spent: int) -> float:
        """Return the factor from the matrices of `sums` to the information of the images."""
        return PRECISION * len(self.times)


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
