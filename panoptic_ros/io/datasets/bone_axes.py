"""Which axes the bones of another skeleton have, found from how its joints lie on them."""

from __future__ import annotations

from itertools import permutations, product

import numpy as np

from panoptic_ros.domain.segments import SegmentModel
from panoptic_ros.errors import DataError

Array = np.ndarray
FARTHEST = 30.0  # deg on average, between where joints lie on the bones of both


def bone_axes(model: SegmentModel, places: Array, frames: Array) -> Array:
    """The rotation (3, 3) that gives the axes of our segments from those of bones, the same for all bones.

    In a T posture bones of a skeleton have equal axes, some way or other round: of the 24 ways, that which
    brings the children of all bones nearest to where ours have them.

    Args:
        places: (T, S, 3) m, frames: (T, S, 3, 3), world from bone, in the order of our segments; NaN = the
            other skeleton has none.

    Raises:
        DataError: if they do not lie alike in any way.
    """
    found, wanted = [], []
    for s, parent in enumerate(model.parents):
        if parent < 0:
            continue
        arms = (frames[:, parent].swapaxes(-1, -2) @ (places[:, s] - places[:, parent])[..., None])[..., 0]
        arms = arms[np.isfinite(arms).all(-1)]
        if len(arms):
            arm = np.median(arms, axis=0)
            found.append(arm / max(float(np.linalg.norm(arm)), 1e-9))
            wanted.append(model.shares[s] / np.linalg.norm(model.shares[s]))
    ways = [
        np.array([sign * np.eye(3)[axis] for sign, axis in zip(signs, axes)])
        for axes in permutations(range(3))
        for signs in product((1.0, -1.0), repeat=3)
    ]
    turns = [way for way in ways if np.linalg.det(way) > 0.0]
    if not found:
        raise DataError("no two joints of a bone are there at the same time")
    angles = [float(np.mean(_degrees(np.array(found) @ turn.T, np.array(wanted)))) for turn in turns]
    best = int(np.argmin(angles))
    if angles[best] > FARTHEST:
        raise DataError(
            f"joints lie {angles[best]:.0f} deg off where bones of our skeleton have them; are orientations "
            "those of the bones, from the bone to the world?"
        )
    return turns[best]


def _degrees(a: Array, b: Array) -> Array:
    found: Array = np.degrees(np.arccos(np.clip((a * b).sum(-1), -1.0, 1.0)))
    return found
