"""How certain the clocks are, and which cameras they are relative to."""

from __future__ import annotations

import numpy as np

from panoptic_ros.offsets.estimate import Fit

Array = np.ndarray
KNOWN = 0.012  # s, standard deviation up to which an offset counts as known
STAMP_JITTER = 5e-4  # s, of single stamps; all joints of a frame share it
LONG_BLOCK, SHORT_BLOCK = 1.0, 0.25  # s over which means of residuals are taken
LEAST_BLOCK = 5  # rays
FEW_BLOCKS = 20
EXCESS = 1.5  # ratio of variances beyond which means of residuals show a bias
NORMAL_MEDIAN = 0.6745  # of |x|
MIXED_NOISE = 1.38  # this ratio for independent noise: few rays in a block, and some much noisier than others
AGREE = 3e-3  # s, offsets that differ less are the same
CHANCE = 2.0  # standard deviations of their difference, up to which they may differ by chance


def covariance_of(fit: Fit, prior: Array) -> Array:
    """Covariance (2C, 2C) of (offsets, drifts) about their means over the cameras.

    It is that of the estimate, inflated if noise is correlated over several frames, plus the jitter of
    stamps and the effect of detector biases: a joint that is detected 25 mm ahead of a person who walks by
    at 1 m/s looks like a clock that is 25 ms off.
    """
    cameras = len(fit.offsets)
    covariance = np.linalg.inv(fit.information / inflation(fit) + np.diag(prior**-2.0))
    covariance += np.diag(np.minimum(_floor(fit), prior**2))
    gauge = np.kron(np.eye(2), np.eye(cameras) - 1.0 / cameras)
    covariances: Array = gauge @ covariance @ gauge.T
    return covariances


def honest_information(fit: Fit, prior: Array) -> Array:
    """Information (2C, 2C) that goes with `covariance_of`, without the prior."""
    weak = np.diag(1e-3 * prior**-2.0)  # so that it can be inverted
    covariance = np.linalg.inv(fit.information / inflation(fit) + weak)
    return np.linalg.inv(covariance + np.diag(np.minimum(_floor(fit), prior**2))) - 0.99 * weak


def inflation(fit: Fit) -> float:
    """Factor of the variances, at least 1: squared excess, as correlated noise outlasts short blocks."""
    return _excess(*_block_means(fit, SHORT_BLOCK)) ** 2


def _floor(fit: Fit) -> Array:
    """Variance (2C,) that more joints do not reduce: jitter of stamps, and biases of the detector."""
    cameras = len(fit.offsets)
    frames = [len(np.unique(fit.seen.stamp[fit.seen.camera == c])) for c in range(cameras)]
    jitter = STAMP_JITTER**2 / np.maximum(frames, 1.0)
    return np.concatenate([jitter + _bias_variance(fit, detector_bias(fit)), np.zeros(cameras)])


def detector_bias(fit: Fit) -> float:
    """How far (m) joints are detected from where the rays of all cameras meet, over seconds.

    It is taken across the motion, which clocks do not change. It is 0 if means over blocks of residuals are
    as small as independent noise makes them.
    """
    means, expected = _block_means(fit, LONG_BLOCK)
    if _excess(means, expected) < EXCESS:
        return 0.0
    whole = (np.median(np.abs(means)) / NORMAL_MEDIAN) ** 2
    return float(np.sqrt(max(whole - np.median(expected), 0.0)))


def _block_means(fit: Fit, length: float) -> tuple[Array, Array]:
    """Mean residuals (B,) m of a joint, camera and `length` s, and their variances (B,) if independent."""
    seen = fit.seen
    if not len(seen.stamp):
        return np.empty(0), np.empty(0)
    speed = np.linalg.norm(fit.across, axis=1)
    normal = np.stack([-fit.across[:, 1], fit.across[:, 0]], axis=1) / np.maximum(speed, 1e-9)[:, None]
    normal *= np.where(normal[:, :1] < 0.0, -1.0, 1.0)  # to and fro have one normal
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
    """How many times larger the variance of means is than independent noise would make it, at least 1."""
    if len(means) < FEW_BLOCKS:
        return 1.0
    ratio = float(np.median(means**2 / np.maximum(expected, 1e-18))) / NORMAL_MEDIAN**2 / MIXED_NOISE
    return max(1.0, ratio)


def _bias_variance(fit: Fit, bias: float) -> Array:
    """Variance (C,) s^2 that a bias of `bias` m gives the offsets.

    People who move in another direction have another bias. One direction of one person counts as one bias,
    however many joints and frames it has.
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


def acquainted(covariance: Array) -> Array:
    """Cameras (C,) whose offsets are known against each other; all, if there are no two of them.

    So a camera that sees no motion, and may have any offset, does not spoil what is known of the others.
    """
    members = np.ones(len(covariance), bool)
    while members.sum() > 1:
        inside = covariance[np.ix_(members, members)]
        shared = inside.mean(axis=1)
        variances = np.diag(inside) - 2.0 * shared + shared.mean()
        if variances.max() <= KNOWN**2:
            return members
        members[np.flatnonzero(members)[variances.argmax()]] = False
    return np.ones(len(covariance), bool)


def common_shift(offsets: Array, deviations: Array) -> float:
    """The unobservable part that all offsets (C,) share, s, which is subtracted.

    If most cameras agree with each other, they keep their stamps; otherwise the mean is 0.
    """
    best = np.zeros(len(offsets), bool)
    for offset, deviation in zip(offsets, deviations):
        near = np.abs(offsets - offset) <= np.maximum(AGREE, CHANCE * np.hypot(deviations, deviation))
        if near.sum() > best.sum():
            best = near
    return float(offsets[best].mean()) if 2 * best.sum() > len(offsets) else float(offsets.mean())
