"""The joints of one body together, from what is known of it and the rays of a few views.

Gauss-Newton on the normal equations of all joints; see `held` for what is known, and from where.
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.domain import SkeletonModel

Array = np.ndarray

TRUSTED = 2.0  # standard deviations; scale of the Cauchy weights of rays
STEPS, SMALL = 6, 1e-4  # of Gauss-Newton, at most; m, of a step after which none follows
GROWTH = 5.0  # of covariances: bones and 2D joints err much the same from frame to frame
NEAR = 0.02  # m, in front of a camera


class Body(NamedTuple):
    """bones (B, 2) of the skeleton; trunk (K,): its root and the joints next to it."""

    bones: Array
    trunk: Array

    @classmethod
    def of(cls, skeleton: SkeletonModel) -> Body:
        """That of a skeleton."""
        bones = np.array(skeleton.bones, np.int64).reshape(-1, 2)
        return cls(bones, np.unique(np.append(bones[bones[:, 0] == skeleton.root, 1], skeleton.root)))


class Known(NamedTuple):
    """What is known of a person besides images.

    places (J, 3) m, NaN = nothing; information (J, 3, 3) 1/m^2 of them; vectors (B, 3) m along bones and
    their standard deviations slack (B,) m; lengths (B,) m, NaN = not learnt, and bone m, how exact they are;
    still (J, 3) m where they were a moment ago, and rise m, how far the trunk moves upwards, up (3,).
    """

    places: Array
    information: Array
    vectors: Array
    slack: Array
    lengths: Array
    bone: float
    still: Array
    up: Array
    rise: float


class Rays(NamedTuple):
    """R rays: joints (R,), 2D points (R, 2) on the plane at distance 1, their precisions (R,), rotations
    (R, 3, 3) and origins (R, 3) m of the views: x_cam = rotation x + origin."""

    joints: Array
    points: Array
    precisions: Array
    rotations: Array
    origins: Array


def estimate(known: Known, rays: Rays, body: Body) -> tuple[Array, Array, Array]:
    """Places (J, 3) m, covariances (J, 3, 3) m^2, NaN = not known; residuals (R,) in standard deviations."""
    count = len(known.places)
    x = known.places.copy()
    active = np.isfinite(x[:, 0])
    used = np.flatnonzero(active[body.bones].all(axis=1))
    normal = np.zeros((3 * count, 3 * count))
    residuals = np.zeros(len(rays.joints))
    for _ in range(STEPS):
        normal, right, residuals = _normal_equations(known, rays, body, used, x, active)
        step = np.linalg.solve(normal, right).reshape(count, 3)
        x[active] += step[active]
        if np.abs(step).max() < SMALL:
            break
    blocks = np.linalg.inv(normal).reshape(count, 3, count, 3)
    covariances = GROWTH * blocks[np.arange(count), :, np.arange(count)]
    covariances[~active] = np.nan
    return x, covariances, residuals


def _normal_equations(
    known: Known, rays: Rays, body: Body, used: Array, x: Array, active: Array
) -> tuple[Array, Array, Array]:
    """The matrix (3J, 3J), the right side (3J,), and residuals (R,) of the rays at x (J, 3)."""
    count, eye = len(x), np.eye(3)
    blocks, right = np.zeros((count, count, 3, 3)), np.zeros((count, 3))
    diagonal = np.arange(count)
    blocks[diagonal, diagonal] = np.where(active[:, None, None], known.information, eye)
    gaps = np.where(active[:, None], known.places - x, 0.0)
    right += (blocks[diagonal, diagonal] @ gaps[..., None])[..., 0]
    (a, b), trunk = body.bones[used].T, body.trunk
    vectors = x[b] - x[a]
    stiff = eye / known.slack[used, None, None] ** 2
    _add_differences(blocks, right, a, b, stiff, known.vectors[used] - vectors)
    length = np.linalg.norm(vectors, axis=-1)
    learnt = np.isfinite(known.lengths[used]) & (length > 1e-3)
    along = vectors[learnt] / length[learnt, None]
    weights = along[:, :, None] * along[:, None, :] / known.bone**2
    missing = (known.lengths[used][learnt] - length[learnt])[:, None] * along
    _add_differences(blocks, right, a[learnt], b[learnt], weights, missing)
    trunk = trunk[active[trunk]]
    if len(trunk):
        stiff = np.outer(known.up, known.up) / (known.rise * len(trunk)) ** 2
        blocks[np.ix_(trunk, trunk)] += stiff
        right[trunk] -= stiff @ (x[trunk] - known.still[trunk]).sum(axis=0)
    seen = (rays.rotations @ x[rays.joints][..., None])[..., 0] + rays.origins
    depth = np.maximum(seen[:, 2], NEAR)
    plane = seen[:, :2] / depth[:, None]
    errors = rays.points - plane
    residuals = np.linalg.norm(errors, axis=-1) * rays.precisions
    weight = rays.precisions**2 / (1.0 + (residuals / TRUSTED) ** 2) * (seen[:, 2] > NEAR)
    slopes = (rays.rotations[:, :2] - plane[..., None] * rays.rotations[:, 2:]) / depth[:, None, None]
    turned = np.swapaxes(slopes, 1, 2) * weight[:, None, None]
    np.add.at(blocks, (rays.joints, rays.joints), turned @ slopes)
    np.add.at(right, rays.joints, (turned @ errors[..., None])[..., 0])
    normal = np.swapaxes(blocks, 1, 2).reshape(3 * count, 3 * count)
    return normal, right.ravel(), residuals


def _add_differences(blocks: Array, right: Array, a: Array, b: Array, weights: Array, missing: Array) -> None:
    """Add, in place, that x[b] - x[a] should grow by `missing` (B, 3) m, with weights (B, 3, 3) or (3, 3)."""
    weights = np.broadcast_to(weights, (len(a), 3, 3))
    pull = (weights @ missing[..., None])[..., 0]
    np.add.at(blocks, (a, a), weights)
    np.add.at(blocks, (b, b), weights)
    np.add.at(blocks, (a, b), -weights)
    np.add.at(blocks, (b, a), -weights)
    np.add.at(right, b, pull)
    np.add.at(right, a, -pull)
