"""Compute the uncertainty of the clocks, and choose the cameras that define their common reference."""

from __future__ import annotations

import numpy as np

from panoptic_ros.offsets.estimate import ClockFit

Array = np.ndarray
STAMP_JITTER = 5e-4  # s, jitter of a single timestamp; all joints of a frame share it
LONG_BLOCK, SHORT_BLOCK = 1.0, 0.25  # s, block lengths over which residuals are averaged
LEAST_BLOCK = 5  # minimum number of rays in a block
FEW_BLOCKS = 20  # minimum number of blocks to estimate the variance excess
EXCESS = 1.5  # ratio of variances beyond which the mean residuals show a bias
NORMAL_MEDIAN = 0.6745  # median of |x| for a standard normal x
MIXED_NOISE = 1.38  # variance ratio of independent noise in `_excess`: blocks have few rays of unequal noise


def covariance_of(fit: ClockFit, prior: Array) -> Array:
    """Return the covariance (2C, 2C) of (offsets, drifts) about their means over the cameras.

    It is the covariance of the estimate, inflated if noise is correlated over several frames. Timestamp
    jitter and the effect of detector biases are added. For example, a joint detected 25 mm ahead of a person
    who walks at 1 m/s looks like a clock that is 25 ms off.
    """
    cameras = len(fit.offsets)
    covariance = np.linalg.inv(fit.information / inflation(fit) + np.diag(prior**-2.0))
    covariance += np.diag(np.minimum(_floor(fit), prior**2))
    gauge = np.kron(np.eye(2), np.eye(cameras) - 1.0 / cameras)
    covariances: Array = gauge @ covariance @ gauge.T
    return covariances


def honest_information(fit: ClockFit, prior: Array) -> Array:
    """Return the information (2C, 2C) that corresponds to `covariance_of`, without the prior."""
    weak = np.diag(1e-3 * prior**-2.0)  # makes the information invertible
    covariance = np.linalg.inv(fit.information / inflation(fit) + weak)
    return np.linalg.inv(covariance + np.diag(np.minimum(_floor(fit), prior**2))) - 0.99 * weak


def inflation(fit: ClockFit) -> float:
    """Return the factor of the variances, at least 1: the squared excess of short blocks.

    It is squared because correlated noise is longer than a short block.
    """
    return _excess(*_block_means(fit, SHORT_BLOCK)) ** 2


def _floor(fit: ClockFit) -> Array:
    """Return the variance (2C,) that more joints do not reduce: timestamp jitter and detector biases."""
    cameras = len(fit.offsets)
    frames = [len(np.unique(fit.seen.stamp[fit.seen.camera == c])) for c in range(cameras)]
    jitter = STAMP_JITTER**2 / np.maximum(frames, 1.0)
    return np.concatenate([jitter + _bias_variance(fit, detector_bias(fit)), np.zeros(cameras)])


def detector_bias(fit: ClockFit) -> float:
    """Return the typical distance (m) of detected joints from the point where the rays of all cameras meet.

    It is averaged over blocks of `LONG_BLOCK`, and measured across the motion, where clocks have no effect.
    It is 0 if the means of residuals over blocks are as small as expected for independent noise.
    """
    means, expected = _block_means(fit, LONG_BLOCK)
    if _excess(means, expected) < EXCESS:
        return 0.0
    whole = (np.median(np.abs(means)) / NORMAL_MEDIAN) ** 2
    return float(np.sqrt(max(whole - np.median(expected), 0.0)))


def _block_means(fit: ClockFit, length: float) -> tuple[Array, Array]:
    """Return mean residuals (B,) m per joint, camera and block of `length` s, with their variances (B,) m^2.

    The variances are those of independent residuals.
    """
    seen = fit.seen
    if not len(seen.stamp):
        return np.empty(0), np.empty(0)
    speed = np.linalg.norm(fit.across, axis=1)
    normal = np.stack([-fit.across[:, 1], fit.across[:, 0]], axis=1) / np.maximum(speed, 1e-9)[:, None]
    normal *= np.where(normal[:, :1] < 0.0, -1.0, 1.0)  # motion to and fro has the same normal
    miss = (normal * fit.misses).sum(axis=1)
    block = np.floor(seen.stamp / length).astype(np.int64)
    keys = np.stack([seen.track, seen.joint, seen.camera, block], axis=1)
    _, group, counts = np.unique(keys, axis=0, return_inverse=True, return_counts=True)
    group = group.reshape(-1)
    means = np.bincount(group, miss) / counts
    scatter = np.bincount(group, (miss - means[group]) ** 2) / np.maximum(counts - 1, 1)
    enough = counts >= LEAST_BLOCK
    return means[enough], scatter[enough] / counts[enough]


def _excess(means: Array, expected: Array) -> float:
    """Return the ratio of the variance of means to that expected for independent noise, at least 1."""
    if len(means) < FEW_BLOCKS:
        return 1.0
    ratio = float(np.median(means**2 / np.maximum(expected, 1e-18))) / NORMAL_MEDIAN**2 / MIXED_NOISE
    return max(1.0, ratio)


def _bias_variance(fit: ClockFit, bias: float) -> Array:
    """Return the variance (C,) s^2 of the offsets that a detector bias of `bias` m causes.

    Persons who move in another direction have another bias. One direction of one person is one bias,
    regardless of the number of joints and frames.
    """
    cameras = len(fit.offsets)
    if bias == 0.0:
        return np.zeros(cameras)
    speed = np.linalg.norm(fit.across, axis=1)
    way = 2 * (fit.across[:, 0] > 0.0) + (fit.across[:, 1] > 0.0)
    keys = np.stack([fit.seen.camera, fit.seen.track, way], axis=1)
    groups, group = np.unique(keys, axis=0, return_inverse=True)
    pull = np.bincount(group.reshape(-1), fit.precision * speed)
    pulls = np.bincount(groups[:, 0], pull**2, cameras)
    strength = np.bincount(fit.seen.camera, fit.precision * speed**2, cameras)
    variances: Array = bias**2 * pulls / np.maximum(strength, 1e-12) ** 2
    return variances
