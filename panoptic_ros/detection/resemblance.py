"""Distances between 2D poses, and between 2D poses and expected people, over their joints."""

from __future__ import annotations

import numpy as np

from panoptic_ros.kernels import njit

Array = np.ndarray
COMMON = 3  # least number of joints that both must have


def apart(points: Array, scores: Array, others: Array, there: Array) -> Array:
    """Return the median joint distances (N, P) of 2D poses, as shares of the height of the taller.

    The distance is infinite for pairs with fewer than `COMMON` joints in common. Heights are the longer sides
    of the boxes round the joints.

    Args:
        points: (N, J, 2) px.
        scores: (N, J), 0 = missing.
        others: (P, J, 2) px.
        there: (P, J), 0 = missing.
    """
    places, elsewhere = (np.array(part, np.float64, order="C") for part in (points, others))
    shares: Array = median_distances(places, scores > 0.0, elsewhere, there > 0.0)
    return shares


@njit(cache=True, error_model="numpy")
def median_distances(points, seen, others, known):
    """Compute `apart`, given which joints are seen (N, J) and known (P, J)."""
    shares = np.full((len(points), len(others)), np.inf)
    own, theirs = _extents(points, seen), _extents(others, known)
    gaps = np.empty(points.shape[1])
    for i in range(len(points)):
        for k in range(len(others)):
            count = 0
            for j in range(len(gaps)):
                if seen[i, j] and known[k, j]:
                    across, down = points[i, j, 0] - others[k, j, 0], points[i, j, 1] - others[k, j, 1]
                    gaps[count] = np.sqrt(across * across + down * down)
                    count += 1
            if count >= COMMON:
                half = (count - 1) // 2
                middle = np.partition(gaps[:count], half)[half]
                shares[i, k] = middle / max(own[i], theirs[k], 1e-9)
    return shares


@njit(cache=True, error_model="numpy")
def _extents(points, there):
    """Return the longer sides (P,) of the boxes round points (P, J, 2); 0 without points."""
    extents = np.zeros(len(points))
    for p in range(len(points)):
        for axis in range(2):
            low, high = np.inf, -np.inf
            for j in range(points.shape[1]):
                if there[p, j]:
                    low, high = min(low, points[p, j, axis]), max(high, points[p, j, axis])
            extents[p] = max(extents[p], high - low)
    return extents


@njit(cache=True, error_model="numpy")
def distinct(points, seen, overlap):
    """Return which (P,) of the 2D poses (P, J, 2), best first, do not coincide with a better one.

    See `people.without_duplicates`.

    Args:
        seen: (P, J) which joints count.
        overlap: Similarity above which the worse pose is dropped.
    """
    kept = np.ones(len(points), np.bool_)
    sizes = _extents(points, seen)
    for other in range(len(points)):
        for better in range(other):
            if not kept[better]:
                continue
            spread = 2.0 * (0.05 * max(sizes[better], 1.0)) ** 2
            total, common = 0.0, 0
            for j in range(points.shape[1]):
                if seen[better, j] and seen[other, j]:
                    across = points[better, j, 0] - points[other, j, 0]
                    down = points[better, j, 1] - points[other, j, 1]
                    total += np.exp(-(across * across + down * down) / spread)
                    common += 1
            if common and total / common > overlap:
                kept[other] = False
                break
    return kept


def warm_up() -> None:
    """Compile the kernels for distances."""
    distinct(np.zeros((1, COMMON, 2)), np.ones((1, COMMON), np.bool_), 0.5)
    apart(np.zeros((1, COMMON, 2)), np.ones((1, COMMON)), np.zeros((1, COMMON, 2)), np.ones((1, COMMON)))
