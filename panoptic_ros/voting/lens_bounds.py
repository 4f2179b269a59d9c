"""Bounds of lens distortion: where an image ends, and how far a small move of a point moves its image."""
from __future__ import annotations

import numpy as np

Array = np.ndarray
BINS = 256
FARTHEST = 10.0  # normalised radius up to which lenses are bounded at most
BEYOND = 1.5  # the same, in radii that an image reaches


def seen_radius(distortion: Array, fold_radius: float, image_radius: float) -> float:
    """Undistorted radius beyond which nothing can be seen in an image; perhaps infinite.

    Args:
        distortion: (5,) k1, k2, p1, p2, k3.
        fold_radius: undistorted radius beyond which nothing is seen anyway.
        image_radius: of the distorted image point in the image that is farthest from the axis.
    """
    k1, k2, p1, p2, k3 = distortion
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


def slope_bounds(distortion: Array, seen: float) -> tuple[Array, float]:
    """Bounds of the Jacobian of `Intrinsics.distort` by the distance from the axis.

    Args:
        distortion: (5,) k1, k2, p1, p2, k3.
        seen: undistorted radius beyond which nothing is seen.

    Returns:
        bounds (BINS, 2) and end: of all points whose radius is at most (b + 1) * end / BINS, the diagonal
        entries are not larger than bounds[b, 0], the others than bounds[b, 1]. True bounds: every term
        of the polynomials is taken at the worst end of each bin.
    """
    k1, k2, p1, p2, k3 = distortion
    end = min(BEYOND * seen, FARTHEST)
    edges = np.linspace(0.0, end, BINS + 1)
    low, high = (edges[:-1] * (1.0 - 1e-6)) ** 2, (edges[1:] * (1.0 + 1e-6)) ** 2
    bent = _largest(low, high, (1.0, k1, k2, k3))  # across the radius
    along = _largest(low, high, (1.0, 3.0 * k1, 5.0 * k2, 7.0 * k3))  # along it
    cross = _largest(low, high, (0.0, k1, 2.0 * k2, 3.0 * k3))  # half of their difference, at most
    tangential = np.sqrt(high) * np.array([[6.0], [2.0]]) * (abs(p1) + abs(p2))
    bounds = np.stack([np.maximum(bent, along), cross]) + tangential
    return np.ascontiguousarray(np.maximum.accumulate(bounds, axis=1).T), end


def _largest(low: Array, high: Array, coefficients: tuple[float, ...]) -> Array:
    """Bounds (B,) of the absolute value of a polynomial on intervals low..high (B,), all >= 0."""
    least, most = np.zeros(len(low)), np.zeros(len(low))
    for power, factor in enumerate(coefficients):
        ends = factor * low**power, factor * high**power
        least += np.minimum(*ends)
        most += np.maximum(*ends)
    return np.maximum(np.abs(least), np.abs(most))
