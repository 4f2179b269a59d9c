"""Simulated detections of a body: several kinds of noise, gaps, outliers and swapped limbs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from panoptic_ros.domain import Rig

Array = np.ndarray
SWAPS = (("Elbow", "Wrist"), ("Knee", "Ankle"))
TRUNK_RADIUS = 0.14  # m; radius of the capsule of a trunk


@dataclass(frozen=True)
class JointNoise:
    """Errors of 2D joints: standard deviations in px at `focal`, probabilities per joint, and scores.

    Args:
        white: Uncorrelated noise, px.
        correlated: Time-correlated noise, px.
        correlation: Correlation time of that noise, s.
        bias: Constant error of each joint and camera, px.
        hidden: Noise factor of joints behind a trunk.
        missing, missing_hidden: Probability that a visible or a hidden joint is missing.
        outliers, outlier_px: Probability and size in px of outliers.
        swaps: Probability per instant that left and right limbs are swapped.
        score, score_hidden: Mean score of visible and of hidden joints.
        focal: Focal length in px for which the px values hold. They scale with the camera's focal length.
    """

    white: float = 4.5
    correlated: float = 7.5
    correlation: float = 0.25
    bias: float = 6.0
    hidden: float = 2.5
    missing: float = 0.05
    missing_hidden: float = 0.40
    outliers: float = 0.02
    outlier_px: float = 90.0
    swaps: float = 0.01
    score: float = 0.85
    score_hidden: float = 0.45
    focal: float = 1050.0


def detect_joints(
    rng: np.random.Generator,
    rig: Rig,
    points: Array,
    trunks: Array,
    names: tuple[str, ...],
    noise: JointNoise,
    rate: float,
) -> tuple[Array, Array]:
    """Return detected pixels (C, T, K, 2), NaN = missing, and scores (C, T, K).

    Args:
        points: True positions (T, K, 3) m of the detector's joints.
        trunks: Lower and upper ends (P, T, 2, 3) m of all people's trunks, which hide joints.
        rate: Rate of the points, Hz.
    """
    shape = (len(rig.cameras), *points.shape[:2])
    pixels, scores = np.full((*shape, 2), np.nan), np.zeros(shape)
    swapped = [
        [(names.index("l" + n), names.index("r" + n)) for n in pair]
        for pair in SWAPS
        if all(side + n in names for n in pair for side in "lr")
    ]
    for c, camera in enumerate(rig.cameras):
        scale = camera.intrinsics.matrix[0, 0] / noise.focal
        found, seen = camera.project(points)
        seen &= camera.contains(found)
        hidden = np.any([_behind(points, trunk, camera.centre) for trunk in trunks], axis=0)
        factor = np.where(hidden, noise.hidden, 1.0)[..., None]
        error = noise.white * rng.normal(size=found.shape)
        error += noise.correlated * _wandering(rng, found.shape, noise.correlation * rate)
        error += noise.bias * rng.normal(size=found.shape[1:])
        found = found + scale * factor * error
        wrong = rng.random(shape[1:]) < noise.outliers
        found[wrong] += scale * noise.outlier_px * rng.normal(size=(int(wrong.sum()), 2))
        for pairs in swapped:
            now = rng.random(shape[1]) < noise.swaps
            for left, right in pairs:
                found[now, left], found[now, right] = found[now, right], found[now, left].copy()
        gone = rng.random(shape[1:]) < np.where(hidden, noise.missing_hidden, noise.missing)
        score = np.where(hidden, noise.score_hidden, noise.score) + 0.08 * rng.normal(size=shape[1:])
        there = seen & ~gone
        pixels[c][there], scores[c][there] = found[there], np.clip(score, 0.05, 1.0)[there]
    return pixels, scores


def _wandering(rng: np.random.Generator, shape: tuple[int, ...], steps: float) -> Array:
    """Return first-order noise (T, ...) of variance 1 with a correlation time of `steps` steps."""
    keep = np.exp(-1.0 / max(steps, 1e-3))
    drive = np.sqrt(1.0 - keep * keep) * rng.normal(size=shape)
    found = np.empty(shape)
    found[0] = rng.normal(size=shape[1:])
    for t in range(1, shape[0]):
        found[t] = keep * found[t - 1] + drive[t]
    return found


def _behind(points: Array, trunk: Array, centre: Array) -> Array:
    """Return a mask (T, K) of joints that the trunk hides from the camera.

    The trunk is seven spheres along the spine. Only spheres whose depth on the ray is more than 0.12 m less
    than that of the joint hide it.
    """
    along = np.linspace(0.0, 1.0, 7)[None, :, None]
    spine = trunk[:, None, 0] * (1 - along) + trunk[:, None, 1] * along
    ray = points - centre
    length = np.linalg.norm(ray, axis=-1)
    ray = ray / length[..., None]
    to_spine = spine - centre
    depth = np.einsum("tkj,tsj->tks", ray, to_spine)
    apart2 = (to_spine**2).sum(-1)[:, None] - depth**2
    hidden: Array = ((apart2 < TRUNK_RADIUS**2) & (depth < length[..., None] - 0.12)).any(-1)
    return hidden
