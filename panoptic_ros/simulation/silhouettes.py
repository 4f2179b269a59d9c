"""Bounding boxes of people in images, and the test for people seen from behind."""

from __future__ import annotations

import numpy as np

from panoptic_ros.simulation.skeleton import J

Array = np.ndarray


def boxes_of(points: Array, visible: Array) -> Array:
    """Return boxes (..., 4) px (left, top, right, bottom) of the visible joints (..., J); NaN if none."""
    low = np.where(visible[..., None], points, np.inf).min(-2)
    high = np.where(visible[..., None], points, -np.inf).max(-2)
    boxes = np.concatenate([low, high], axis=-1)
    return np.where(np.any(visible, axis=-1)[..., None], boxes, np.nan)


def box_overlap(a: Array, b: Array) -> float:
    """Return the intersection area of two boxes divided by the smaller area; 0 for empty boxes."""
    sides = np.minimum(a[2:], b[2:]) - np.maximum(a[:2], b[:2])
    smaller = min(float(np.prod(box[2:] - box[:2])) for box in (a, b))
    if not (sides > 0.0).all() or not smaller > 0.0:
        return 0.0
    return float(np.prod(sides)) / smaller


def seen_from_behind(joints: Array, centres: Array) -> Array:
    """Return a mask (C, P) of people who have their back to the camera.

    Args:
        joints: Joints (C, P, 19, 3) m.
        centres: Camera centres (C, 3) m.
    """
    across = joints[:, :, J["lShoulder"]] - joints[:, :, J["rShoulder"]]
    forward = np.cross(across, [0.0, 0.0, 1.0])
    towards = centres[:, None] - joints[:, :, J["Neck"]]
    behind: Array = (forward * towards).sum(-1) < 0.0
    return behind
