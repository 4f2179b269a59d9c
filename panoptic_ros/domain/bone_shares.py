"""Lengths of bones as shares of the stature, and the scale of a reconstruction from them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from panoptic_ros.domain.skeleton import SkeletonModel

Array = np.ndarray
# m, mean stature of adults and its spread (NCD-RisC 2016: men 1.71 to 1.78, women 1.59 to 1.65)
STATURE_M, STATURE_SD_M = 1.71, 0.095
# Lengths between joint centres over the stature: means of Drillis and Contini 1966 and of de Leva 1996.
SHARES = {
    ("Shoulder", "Elbow"): 0.168,
    ("Elbow", "Wrist"): 0.149,
    ("Hip", "Knee"): 0.244,
    ("Knee", "Ankle"): 0.243,
}
SHARES_SD = 0.02  # relative, of the scale from the bones of one person of known stature
ANKLE_SHARE = 0.05  # height of the ankle's centre above the floor over the stature, same sources


class Bones(NamedTuple):
    """Bones of a skeleton.

    Args:
        ends: (B, 2) joints. lengths: (B,) m, of a person of mean stature.
    """

    ends: Array
    lengths: Array


def bones_of(skeleton: SkeletonModel, joints: Sequence[int] | Array) -> Bones:
    """Return the bones of a skeleton, as indices into its used joints; joints named lKnee or left_knee."""
    index = {_plain(skeleton.joint_names[j]): k for k, j in enumerate(joints)}
    pairs = [(side + a.lower(), side + b.lower(), share) for (a, b), share in SHARES.items() for side in "lr"]
    rows = [(index[a], index[b], share * STATURE_M) for a, b, share in pairs if a in index and b in index]
    return Bones(np.array([row[:2] for row in rows], int).reshape(-1, 2), np.array([row[2] for row in rows]))


def _plain(name: str) -> str:
    return name.lower().replace("_", "").replace("left", "l", 1).replace("right", "r", 1)


def log_scale(points: Array, bones: Bones) -> float:
    """Return the logarithm of metres per unit of joints (K, J, 3); NaN without bones.

    The median length of each bone over time counts, then the median over bones.
    """
    lengths = np.linalg.norm(points[:, bones.ends[:, 0]] - points[:, bones.ends[:, 1]], axis=-1)
    known = np.isfinite(lengths).any(axis=0)
    if not known.any():
        return float("nan")
    medians = np.nanmedian(lengths[:, known], axis=0)
    return float(np.median(np.log(bones.lengths[known] / np.maximum(medians, 1e-9))))
