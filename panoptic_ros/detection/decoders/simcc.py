"""Decoder of one distribution per axis and joint, for one person: SimCC, as in RTMPose.

Li et al., "SimCC: a simple coordinate classification perspective for human pose estimation", 2022. The values
are not probabilities: they are not normalised, may exceed 1, and are 0 or negative where the joint is absent.
"""

from __future__ import annotations

import numpy as np

Array = np.ndarray


def decode_simcc(across: Array, down: Array, split: float) -> tuple[Array, Array]:
    """Decode joints (K, 2) in input px, and scores (K,), from values (K, w split) and (K, h split)."""
    bins = np.stack([across.argmax(axis=1), down.argmax(axis=1)], axis=1)
    scores = np.minimum(across.max(axis=1), down.max(axis=1))
    return bins / split, np.clip(scores, 0.0, 1.0).astype(float)


def simcc_maps(across: Array, down: Array, columns: Array, rows: Array, split: float) -> Array:
    """Return score maps (K, R, C) at input px `columns` (C,) and `rows` (R,): the product of the two axes.

    Each map is scaled so that its peak is the score of the joint.
    """
    scores = decode_simcc(across, down, split)[1]
    x = _sampled(across, columns * split)
    y = _sampled(down, rows * split)
    maps: Array = scores[:, None, None] * y[:, :, None] * x[:, None, :]
    return maps


def _sampled(values: Array, bins: Array) -> Array:
    """Interpolate values (K, B), relative to their maximum, at fractional bins (N,); 0 outside."""
    positive = np.maximum(values, 0.0)
    peak = np.maximum(positive.max(axis=1, keepdims=True), 1e-9)
    grid = np.arange(values.shape[1])
    return np.stack([np.interp(bins, grid, row, left=0.0, right=0.0) for row in positive / peak])
