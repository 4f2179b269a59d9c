"""Bounds of lens distortion: where an image ends, and how far a small move of a point moves its image."""
from __future__ import annotations

import numpy as np

from panoptic_ros.geometry import Lens

Array = np.ndarray
BINS = 256
FARTHEST = 10.0  # normalised radius up to which lenses are bounded at most
BEYOND = 1.5  # the same, in radii that an image reaches


def seen_radius(lens: Lens, terms: Array, fold_radius: float, image_radius: float) -> float:
    """Undistorted radius beyond which nothing can be seen in an image; perhaps infinite.

    Args:
        lens, terms: as in `Intrinsics`.
        fold_radius: undistorted radius beyond which nothing is seen anyway.
        image_radius: of the distorted image point in the image that is farthest from the axis.
    """
    if lens == "fisheye":
        return _seen_by_fisheye(terms, fold_radius, image_radius)
    return _seen_by_brown(terms, fold_radius, image_radius)


def slope_bounds(lens: Lens, terms: Array, seen: float) -> tuple[Array, float]:
    """Bounds of the Jacobian of `Intrinsics.distort` by the distance from the axis.

    Args:
        lens, terms: as in `Intrinsics`.
        seen: undistorted radius beyond which nothing is seen.

    Returns:
        bounds (BINS, 2) and end: of all points whose radius is at most (b + 1) * end / BINS, the diagonal
        entries are not larger than bounds[b, 0], the others than bounds[b, 1]. True bounds: every term
        of the polynomials is taken at the worst end of each bin.
    """
    end = min(BEYOND * seen, FARTHEST)
    edges = np.linspace(0.0, end, BINS + 1)
    low, high = edges[:-1] * (1.0 - 1e-6), edges[1:] * (1.0 + 1e-6)
    bounds = (_bends_of_fisheye if lens == "fisheye" else _bends_of_brown)(terms, low, high)
    return np.ascontiguousarray(np.maximum.accumulate(bounds, axis=1).T), end


def _seen_by_fisheye(terms: Array, fold_radius: float, image_radius: float) -> float:
    """The distorted radius increases up to the fold, so that its end can be enclosed."""
    low, high = 0.0, float(np.arctan(fold_radius))
    factor = (1.0, *terms)
    if high * float(np.polyval(factor[::-1], high * high)) <= image_radius:
        return fold_radius
    for _ in range(60):
        middle = 0.5 * (low + high)
        reached = middle * float(np.polyval(factor[::-1], middle * middle))
        low, high = (middle, high) if reached <= image_radius else (low, middle)
    return min(1.001 * float(np.tan(high)), fold_radius)


def _bends_of_fisheye(terms: Array, low: Array, high: Array) -> Array:
    """`slope_bounds` (2, BINS) between radii low and high (BINS,)."""
    k1, k2, k3, k4 = terms
    near, far = np.arctan(low), np.arctan(high)
    squares = near * near, far * far
    # across the radius theta_d / r, along it d theta_d / d theta cos^2 theta; both fall off with theta
    near_ratio = np.where(near > 0.0, near / np.maximum(low, 1e-300), 1.0)
    across = _scaled(_range(*squares, (1.0, k1, k2, k3, k4)), far / high, near_ratio)
    along = _range(*squares, (1.0, 3.0 * k1, 5.0 * k2, 7.0 * k3, 9.0 * k4))
    along = _scaled(along, 1.0 / (1.0 + high * high), 1.0 / (1.0 + low * low))
    cross = 0.5 * np.maximum(np.abs(along[1] - across[0]), np.abs(along[0] - across[1]))
    return np.stack([np.maximum(np.abs(across).max(0), np.abs(along).max(0)), cross])


def _scaled(values: Array, least: Array, most: Array) -> Array:
    """Bounds (2, B) of values between bounds (2, B) times a factor between two positive bounds (B,)."""
    products = np.stack([values[0] * least, values[0] * most, values[1] * least, values[1] * most])
    return np.stack([products.min(0), products.max(0)])


def _seen_by_brown(terms: Array, fold_radius: float, image_radius: float) -> float:
    k1, k2, p1, p2, k3 = terms
    # of distorted radii that are not larger: those without tangential terms, less 3 |p| r^2
    terms = np.array([k3, 0.0, k2, 0.0, k1, -3.0 * np.hypot(p1, p2), 1.0, -image_radius])
    outside = np.trim_zeros(terms, "f")
    at_end = outside[0] if np.isinf(fold_radius) else np.polyval(outside, fold_radius)
    if at_end <= 0.0 or abs(outside[0]) < 1e-15:  # roots() divides by it
        return fold_radius
    roots = np.roots(outside)
    real = np.abs(roots[(roots.real > 0.0) & (np.abs(roots.imag) < 1e-3 * np.abs(roots))])
    seen = 1.001 * float(real[real < fold_radius].max(initial=0.0))
    return min(seen, fold_radius) if np.polyval(outside, seen) > 0.0 else fold_radius


def _bends_of_brown(terms: Array, low: Array, high: Array) -> Array:
    """`slope_bounds` (2, BINS) between radii low and high (BINS,)."""
    k1, k2, p1, p2, k3 = terms
    squares = low**2, high**2
    bent = np.abs(_range(*squares, (1.0, k1, k2, k3))).max(0)  # across the radius
    along = np.abs(_range(*squares, (1.0, 3.0 * k1, 5.0 * k2, 7.0 * k3))).max(0)  # along it
    cross = np.abs(_range(*squares, (0.0, k1, 2.0 * k2, 3.0 * k3))).max(0)  # half of what they differ
    tangential = np.sqrt(squares[1]) * np.array([[6.0], [2.0]]) * (abs(p1) + abs(p2))
    bounds: Array = np.stack([np.maximum(bent, along), cross]) + tangential
    return bounds


def _range(low: Array, high: Array, coefficients: tuple[float, ...]) -> Array:
    """Bounds (2, B) of a polynomial on intervals low..high (B,), all >= 0."""
    least, most = np.zeros(len(low)), np.zeros(len(low))
    for power, factor in enumerate(coefficients):
        ends = factor * low**power, factor * high**power
        least += np.minimum(*ends)
        most += np.maximum(*ends)
    return np.stack([least, most])
