"""Lens models of OpenCV that extend Brown and Conrady's, with 5, 8, 12 or 14 terms.

The order of terms is OpenCV's. The radial terms are k1 k2 k3, the tangential ones p1 p2. The terms k4 k5 k6
divide the radial polynomial (rational model). The terms s1 to s4 describe a thin prism. The angles tau_x
tau_y (rad) tilt the sensor. Points are on the plane at distance 1 from the camera.
"""

from __future__ import annotations

import numpy as np

Array = np.ndarray
TERMS = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4", "tau_x", "tau_y")
KEPT = (5, 8, 12, 14)  # numbers of terms of a lens after trailing zeros are cut
COUNTS = (0, 1, 2, 4, *KEPT)  # terms that a calibration may give; three are k1 k2 k3, which lack p1 p2


def distort(terms: Array, plane: Array) -> Array:
    """Return distorted points (..., 2) of undistorted ones (..., 2)."""
    bent = _bend(terms, plane)
    return bent if len(terms) < 14 else _through(tilt(terms), bent)


def _bend(terms: Array, plane: Array) -> Array:
    """Return distorted points, for a sensor without tilt."""
    _, _, p1, p2, _ = terms[:5]
    x, y = plane[..., 0], plane[..., 1]
    r2 = x * x + y * y
    above, below, _, _ = _radial(terms, r2)
    radial = above / below
    bent = np.stack(
        [
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        ],
        axis=-1,
    )
    if len(terms) > 8:
        s1, s2, s3, s4 = terms[8:12]
        bent += np.stack([r2 * (s1 + r2 * s2), r2 * (s3 + r2 * s4)], axis=-1)
    return bent


def _radial(terms: Array, r2: Array) -> tuple[Array | float, Array | float, Array | float, Array | float]:
    """Return numerator and denominator of the radial factor, and their derivatives by r2."""
    k1, k2, _, _, k3 = terms[:5]
    above, rise = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3)), k1 + r2 * (2.0 * k2 + 3.0 * r2 * k3)
    if len(terms) == 5:
        return above, 1.0, rise, 0.0
    k4, k5, k6 = terms[5:8]
    return above, 1.0 + r2 * (k4 + r2 * (k5 + r2 * k6)), rise, k4 + r2 * (2.0 * k5 + 3.0 * r2 * k6)


def _bend_jacobian(terms: Array, plane: Array) -> Array:
    """Return the derivative (..., 2, 2) of `_bend` at undistorted points (..., 2)."""
    _, _, p1, p2, _ = terms[:5]
    x, y = plane[..., 0], plane[..., 1]
    r2 = x * x + y * y
    above, below, rise, fall = _radial(terms, r2)
    radial = above / below
    slope = 2.0 * (rise - radial * fall) / below  # d radial / d r2, times 2
    cross = x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y
    dx = radial + x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x
    dy = radial + y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x
    derivative = np.stack([np.stack([dx, cross], -1), np.stack([cross, dy], -1)], axis=-2)
    if len(terms) > 8:
        s1, s2, s3, s4 = terms[8:12]
        prism = np.stack([s1 + 2.0 * r2 * s2, s3 + 2.0 * r2 * s4], axis=-1)
        derivative += 2.0 * prism[..., :, None] * plane[..., None, :]
    return derivative


def tilt(terms: Array) -> Array:
    """Return the homography (3, 3) from an untilted sensor to one tilted about x, then y, as in OpenCV.

    It is the identity with fewer than 14 terms.
    """
    if len(terms) < 14:
        return np.eye(3)
    (cx, cy), (sx, sy) = np.cos(terms[12:]), np.sin(terms[12:])
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, cx, sx], [0.0, -sx, cx]])
    about_y = np.array([[cy, 0.0, -sy], [0.0, 1.0, 0.0], [sy, 0.0, cy]])
    turn = about_y @ about_x
    onto = np.array([[turn[2, 2], 0.0, -turn[0, 2]], [0.0, turn[2, 2], -turn[1, 2]], [0.0, 0.0, 1.0]])
    matrix: Array = onto @ turn
    return matrix


def _through(matrix: Array, points: Array) -> Array:
    """Map points (..., 2) by a homography (3, 3)."""
    h = points @ matrix[:, :2].T + matrix[:, 2]
    mapped: Array = h[..., :2] / h[..., 2:]
    return mapped


def undistort(terms: Array, goal: Array, radius_limit: float) -> Array:
    """Return undistorted points (..., 2) of distorted ones (..., 2), by Newton's method; NaN if none."""
    if not terms.any():
        return goal
    if len(terms) == 14:
        goal, terms = _through(np.linalg.inv(tilt(terms)), goal), terms[:12]
    plane = goal.copy()
    limit = min(radius_limit, 1e3)
    for _ in range(20):
        miss = _bend(terms, plane) - goal
        if not np.nanmax(np.abs(miss), initial=0.0) > 1e-14:
            break
        j = _bend_jacobian(terms, plane)
        det = j[..., 0, 0] * j[..., 1, 1] - j[..., 0, 1] * j[..., 1, 0]
        det = np.where(np.abs(det) > 1e-6, det, 1e-6)
        step_x = (j[..., 1, 1] * miss[..., 0] - j[..., 0, 1] * miss[..., 1]) / det
        step_y = (j[..., 0, 0] * miss[..., 1] - j[..., 1, 0] * miss[..., 0]) / det
        plane = plane - np.stack([step_x, step_y], axis=-1)
        radius = np.linalg.norm(plane, axis=-1, keepdims=True)
        plane = np.where(radius > limit, plane * (limit / np.maximum(radius, 1e-12)), plane)
    good = np.abs(_bend(terms, plane) - goal).max(axis=-1) < 1e-8
    return np.where(good[..., None], plane, np.nan)


def radius_limit(terms: Array) -> float:
    """Return the undistorted radius up to which the distorted radius increases; inf if it always does.

    Tangential and prism terms are ignored. A zero of the rational model's denominator ends the range too.
    """
    clean = np.where(np.abs(terms) < 1e-15, 0.0, terms)  # np.roots divides by them
    above = np.array([clean[4], clean[1], clean[0], 1.0])  # coefficients in r^2, the highest power first
    folds = np.array([7.0, 5.0, 3.0, 1.0]) * above  # d(r * radial)/dr
    roots = np.roots(folds)
    if len(clean) > 5 and clean[5:8].any():
        above, below = _reduced(above, np.array([clean[7], clean[6], clean[5], 1.0]))
        # with s = r^2: d(r above / below) / dr is zero where (above + 2 s above') below = 2 s above below'
        twice = np.array([2.0, 0.0])
        folds = np.polyadd(above, np.polymul(twice, np.polyder(above)))
        falls = np.polymul(twice, np.polyder(below))
        roots = np.concatenate(
            [np.roots(np.polysub(np.polymul(folds, below), np.polymul(above, falls))), np.roots(below)]
        )
    real = roots[(np.abs(roots.imag) < 1e-9) & (roots.real > 0.0)].real
    return float(np.sqrt(real.min())) if real.size else float("inf")


def _reduced(above: Array, below: Array) -> tuple[Array, Array]:
    """Return two polynomials without their common roots, which are no poles of their quotient."""
    left = list(np.roots(above))
    kept = []
    for root in np.roots(below):
        near = [k for k, other in enumerate(left) if abs(other - root) < 1e-9 * abs(root)]
        if near:
            left.pop(near[0])
        else:
            kept.append(root)
    return _with_roots(left), _with_roots(kept)


def _with_roots(roots: list[complex]) -> Array:
    """Return the real polynomial with these roots, highest power first, which is 1 at 0."""
    polynomial = np.real(np.poly(roots)) if roots else np.ones(1)
    return np.asarray(polynomial / polynomial[-1])
