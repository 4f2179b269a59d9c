"""Features of a pattern in images, and their matches between two cameras with known lenses (Lowe 2004)."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

from panoptic_ros.calibration.essential import epipolar_residuals, fitted_essential
from panoptic_ros.calibration.pattern.start import FEWEST, GATE_PX
from panoptic_ros.calibration.pattern.tracks import FeatureMatches
from panoptic_ros.geometry import Intrinsics

Array = np.ndarray
MOST_FEATURES = 2000  # per image
RATIO = 0.8  # greatest ratio of the distances to the best and the second descriptor (Lowe 2004)
SAME_PX = 0.01  # px, features at one place with several orientations


class ImageFeatures(NamedTuple):
    """Features of an image.

    Args:
        pixels: (N, 2) px. plane: (N, 2) the same on the plane at 1 m. descriptors: (N, 128) uint8.
    """

    pixels: Array
    plane: Array
    descriptors: Array


def features_of(grey: Array, lens: Intrinsics) -> ImageFeatures:
    """Return the features of an image (H, W) uint8."""
    found, descriptors = cv2.SIFT.create(MOST_FEATURES, enable_precise_upscale=True).detectAndCompute(
        grey, None
    )
    if not found:
        return ImageFeatures(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros((0, 128), np.uint8))
    pixels = np.array([point.pt for point in found], np.float64)
    first = np.unique(np.round(pixels / SAME_PX), axis=0, return_index=True)[1]
    plane = lens.undistort(pixels[first])
    good = np.isfinite(plane).all(axis=1)
    return ImageFeatures(pixels[first][good], plane[good], descriptors[first][good].astype(np.uint8))


def matched(
    first: ImageFeatures, second: ImageFeatures, pair: tuple[int, int], focal: float
) -> FeatureMatches | None:
    """Return the mutual matches of two images that one essential matrix explains; None if they are few.

    Args:
        pair: Numbers of the cameras. focal: px, mean of both.
    """
    if min(len(first.pixels), len(second.pixels)) < FEWEST:
        return None
    there, distances = _nearest(first.descriptors, second.descriptors)
    back, _ = _nearest(second.descriptors, first.descriptors)
    own = np.flatnonzero((there >= 0) & (back[np.maximum(there, 0)] == np.arange(len(there))))
    if len(own) < FEWEST:
        return None
    a, b, gate = first.plane[own], second.plane[there[own]], GATE_PX / focal
    essential = fitted_essential(a, b, gate)
    if essential is None:
        return None
    own = own[epipolar_residuals(essential, a, b) < gate]
    return FeatureMatches(*pair, own, there[own], distances[own]) if len(own) >= FEWEST else None


def _nearest(descriptors: Array, others: Array) -> tuple[Array, Array]:
    """Return the nearest other descriptor (N,) of each, -1 = ambiguous, and its distance (N,)."""
    nearest, distance = np.full(len(descriptors), -1), np.zeros(len(descriptors))
    pairs = cv2.BFMatcher().knnMatch(descriptors.astype(np.float32), others.astype(np.float32), k=2)
    for n, (best, second) in enumerate(pairs):
        if best.distance < RATIO * second.distance:
            nearest[n], distance[n] = best.trainIdx, best.distance
    return nearest, distance
