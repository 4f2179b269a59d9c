"""Similarity of the body to the images of a segment, each image at its own timestamp (paper, 4.2)."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from panoptic_ros.continuous.elhayek.body_blobs import BodyBlobs, TimedBlobs
from panoptic_ros.continuous.elhayek.energy import PoseSums, PoseTerm
from panoptic_ros.continuous.elhayek.quad_tree import ImageBlobs
from panoptic_ros.continuous.elhayek.similarity import (
    Pairs,
    colour_similarity,
    self_similarity,
    similarity,
)
from panoptic_ros.continuous.elhayek.skeleton import Placed, Skeleton
from panoptic_ros.continuous.problem import LEAST_DEPTH
from panoptic_ros.domain.rig_arrays import RigArrays

Array = np.ndarray
NEAR = 0.3  # m, distance from the body at the start of a fit, up to which image blobs take part
SIGMAS = 2.0  # further distance, in standard deviations of both blobs
# Information of one image, in units of the second derivatives of its similarity: its error is mostly bias, of which these
# know nothing. The value gives the mean error of two rendered captures.
PRECISION = 200.0
LEAST_TOTAL = 1e-12  # self-similarity of an image that does not show the body
SIMILAR = 1e-3  # least colour similarity of an image blob to a model blob


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
        skeleton: Skeleton,
        arrays: RigArrays,
    ):
        self._body, self._skeleton = body, skeleton
        cameras = [image.camera for image in images]
        self.times = np.array([image.time for image in images])
        self._rotations, self._translations = arrays.rotations[cameras], arrays.translations[cameras]
        parts = [_near_body(image.blobs, *one, body) for image, one in zip(images, zip(*self._projected(poses)[:2]))]
        blobs, pairs, totals = zip(*parts)
        first = np.cumsum([0, *(len(own.sigmas) for own in blobs)])
        self._blobs = ImageBlobs(*(np.concatenate(column).astype(np.float64) for column in zip(*blobs)))
        self._weights = np.concatenate(
            [np.full(len(own.sigmas), 1.0 / (len(images) * total)) for own, total in zip(blobs, totals)]
        )
        self._pairs = Pairs(
            np.concatenate([start + own.image for start, own in zip(first, pairs)]),
            np.concatenate([t * len(body.radii) + own.model for t, own in enumerate(pairs)]),
            np.concatenate([own.similar for own in pairs]),
        )

    def sums(self, freedoms: Array) -> PoseSums:
        """Return the energy of degrees of freedom (T, D)."""
        means, sigmas, depths, points, placed = self._projected(freedoms)
        found = similarity(self._blobs, self._weights, means.reshape(-1, 2), sigmas.ravel(), self._pairs)
        slopes = self._skeleton.slopes(placed, self._body.segments, points)
        slopes = self._rotations[:, None] @ slopes  # in the cameras' frames
        of_means = (slopes[..., :2, :] - means[..., None] * slopes[..., 2:, :]) / depths[..., None, None]
        of_sigmas = -slopes[..., 2, :] * (sigmas / depths)[..., None]
        by_means = found.by_means.reshape(means.shape)
        gradients = np.einsum("tne,tned->td", by_means, of_means)
        gradients += np.einsum("tn,tnd->td", found.by_sigmas.reshape(sigmas.shape), of_sigmas)
        weighted = of_means * found.curvatures.reshape(*sigmas.shape, 1, 1)
        flat = (len(freedoms), -1, freedoms.shape[1])
        matrices = weighted.reshape(flat).swapaxes(1, 2) @ of_means.reshape(flat)
        return PoseSums(-found.value, -gradients, matrices)

    def precision(self, freedoms: Array, spent: int) -> float:
        """Return the factor from the matrices of `sums` to the information of the images."""
        return PRECISION * len(self.times)

    def _projected(self, freedoms: Array) -> tuple[Array, Array, Array, Array, Placed]:
        """Return the model blobs in the images, equation 4 of the paper.

        Returns:
            means (T, N, 2) and standard deviations (T, N) on the image planes, depths (T, N) m, positions
            (T, N, 3) m in the world, and the skeleton.
        """
        placed = self._skeleton.place(freedoms)
        points = self._skeleton.points(placed, self._body.segments, self._body.offsets)
        local = points @ self._rotations.swapaxes(1, 2) + self._translations[:, None]
        depths = np.maximum(local[..., 2], LEAST_DEPTH)
        return local[..., :2] / depths[..., None], self._body.sigmas / depths, depths, points, placed


def _near_body(
    image: ImageBlobs, means: Array, sigmas: Array, body: BodyBlobs
) -> tuple[ImageBlobs, Pairs, float]:
    """Return the image blobs near a body that resemble it, the pairs with model blobs, and the self-similarity.

    The self-similarity is that of all image blobs near the body.

    Args:
        means, sigmas: (N, 2) and (N,) of the projected model blobs.
    """
    reach = NEAR * float(np.median(sigmas / body.sigmas))
    inside = (image.means > means.min(axis=0) - reach) & (image.means < means.max(axis=0) + reach)
    near = image.chosen(inside.all(axis=1))
    similar = colour_similarity(near.colours, body.colours)
    gaps = np.linalg.norm(near.means[:, None] - means[None], axis=-1)
    together = (similar > SIMILAR) & (gaps < reach + SIGMAS * np.hypot(near.sigmas[:, None], sigmas[None]))
    alike = together.any(axis=1)
    chosen, model = np.nonzero(together[alike])
    total = float(self_similarity(near).sum())
    return near.chosen(alike), Pairs(chosen, model, similar[alike][chosen, model]), max(total, LEAST_TOTAL)


class ImageMeasurements:
    """Images of a person as `tracking.Measurements`.

    Args:
        images: of the whole recording, ordered by time.
    """

    fits = 2  # the second one chooses the image blobs near the result of the first one

    def __init__(
        self, images: Sequence[TimedBlobs], body: BodyBlobs, skeleton: Skeleton, arrays: RigArrays
    ):
        self._images, self._body, self._skeleton, self._arrays = images, body, skeleton, arrays
        self._times = np.array([image.time for image in images])

    def term(self, fit: int, segment: Array, start: Callable[[Array], Array]) -> PoseTerm | None:
        """Return the term of a fit of a segment (2,) s, None = no image lies in it.

        Args:
            start: gives degrees of freedom (T, D) at times (T,) s, from which the fit starts.
        """
        low, high = np.searchsorted(self._times, segment)
        images = self._images[low:high]
        if not images or not len(self._body.radii):
            return None
        return ImageTerm(images, start(self._times[low:high]), self._body, self._skeleton, self._arrays)
