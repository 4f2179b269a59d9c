"""Similarity of a body of blobs to the blobs of one image, and its derivatives (paper, 4.1).

All lengths are on the normalised image plane, so the focal length of equation 4 is 1.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.continuous.elhayek.polynomials import wendland
from panoptic_ros.continuous.elhayek.quad_tree import ImageBlobs

Array = np.ndarray
COLOUR_REACH = 0.4  # distance in the HSV cylinder (radius 1, height 1) from which colours count as different


class Pairs(NamedTuple):
    """Q pairs of an image blob and a model blob that may overlap.

    Args:
        image, model: (Q,) indices.
        similar: (Q,) similarity of their colours, d of equation 1 of the paper.
    """

    image: Array
    model: Array
    similar: Array


class Similarity(NamedTuple):
    """Similarity of N model blobs to image blobs, with derivatives.

    Args:
        value: equation 5 of the paper.
        by_means: (N, 2) derivatives by the means of the model blobs.
        by_sigmas: (N,) derivatives by their standard deviations.
        curvatures: (N,) curvature, by the means, of the quadratic function that bounds the similarity from below.
    """

    value: float
    by_means: Array
    by_sigmas: Array
    curvatures: Array


def colour_similarity(colours: Array, others: Array) -> Array:
    """Return d of equation 1, 0..1, of colours (I, 3) and (N, 3) as an array (I, N)."""
    gaps = np.linalg.norm(colours[:, None] - others[None], axis=-1)
    return wendland(gaps / COLOUR_REACH)


class Overlaps(NamedTuple):
    """Overlaps of Q pairs of blobs.

    Args:
        values: (Q,) E_ij, the integral of the product of both blobs times the colour similarity.
        across, down: (Q,) from the model blob to the image blob.
        variances: (Q,) sum of both.
    """

    values: Array
    across: Array
    down: Array
    variances: Array


def overlaps(image: ImageBlobs, means: Array, sigmas: Array, pairs: Pairs) -> Overlaps:
    """Return the overlaps of pairs.

    The paper's equation 3 lacks the factor 2 in the exponent. This is the integral that its equation 1 states.

    Args:
        means, sigmas: (N, 2) and (N,) of the projected model blobs.
    """
    across, down = (image.means[pairs.image, axis] - means[pairs.model, axis] for axis in range(2))
    own, model = (image.sigmas**2)[pairs.image], (sigmas**2)[pairs.model]
    variances = own + model
    values = np.exp(-0.5 * (across * across + down * down) / variances)
    values *= pairs.similar * (2.0 * np.pi) * own * model / variances
    return Overlaps(values, across, down, variances)


def self_similarity(image: ImageBlobs) -> Array:
    """Return E_ii (I,) of image blobs."""
    found: Array = np.pi * image.sigmas**2
    return found


def similarity(image: ImageBlobs, weights: Array, means: Array, sigmas: Array, pairs: Pairs) -> Similarity:
    """Return the similarity of model blobs to image blobs.

    Each image blob counts up to its similarity to itself. One that has reached this exerts no force.

    Args:
        weights: (I,) of the image blobs in the sum.
        means, sigmas: (N, 2) and (N,) of the projected model blobs.
    """
    most = self_similarity(image)
    found = overlaps(image, means, sigmas, pairs)
    reached = np.bincount(pairs.image, found.values, len(most))
    pulls = found.values * (weights * (reached < most))[pairs.image] / found.variances
    squares = found.across**2 + found.down**2
    own, model = (image.sigmas**2)[pairs.image], sigmas[pairs.model]
    growths = pulls * (2.0 * own / model + squares * model / found.variances)

    def of_model(values: Array) -> Array:
        return np.bincount(pairs.model, values, len(means))

    return Similarity(
        float(weights @ np.minimum(reached, most)),
        np.column_stack([of_model(pulls * found.across), of_model(pulls * found.down)]),
        of_model(growths),
        of_model(pulls),
    )
