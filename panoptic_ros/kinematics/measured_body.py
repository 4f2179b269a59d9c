"""The body of somebody of whom nothing is known but skeletons: lengths from the first of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from panoptic_ros.domain.segments import SHORTEST, TALLEST, Body, SegmentModel

Array = np.ndarray
ASKED = 10  # skeletons with enough joints
LEAST_LIMBS = 5


class MeasuredBody:
    """Lengths of limbs of one person, skeleton by skeleton."""

    def __init__(self) -> None:
        self._lengths: list[Array] = []

    def take(self, model: SegmentModel, joint_names: Sequence[str], positions: Array) -> Body | None:
        """The body, once enough skeletons have told of it; positions (J, 3) m, NaN = missing.

        A limb is a segment whose proximal joint and whose parent's are joints of the skeleton. The stature is
        that which explains the limbs, by the median; limbs then have their own lengths, left as right.
        """
        limbs = limbs_of(model, joint_names)
        begin, end = np.array([b for _, b, _ in limbs]), np.array([e for _, _, e in limbs])
        if not len(limbs):
            return None
        lengths = np.linalg.norm(positions[end] - positions[begin], axis=-1)
        if np.isfinite(lengths).sum() >= LEAST_LIMBS:
            self._lengths.append(lengths)
        if len(self._lengths) < ASKED:
            return None
        with np.errstate(invalid="ignore"):
            typical = np.nanmedian(np.array(self._lengths), axis=0)
        shares = np.array([np.linalg.norm(model.shares[s]) for s, _, _ in limbs])
        known = np.isfinite(typical)
        stature = float(np.median(typical[known] / shares[known]))
        body = model.body(float(np.clip(stature, SHORTEST, TALLEST)))
        by_name: dict[str, list[float]] = {}
        for (s, _, _), length in zip(limbs, typical):
            if np.isfinite(length):
                by_name.setdefault(model.names[s][1:], []).append(float(length))
        offsets = {}
        for s, _, _ in limbs:
            own = by_name.get(model.names[s][1:])
            if own:
                usual = body.offsets[s]
                offsets[model.names[s]] = usual * (np.mean(own) / np.linalg.norm(usual))
        return body.with_offsets(offsets)


def limbs_of(model: SegmentModel, joint_names: Sequence[str]) -> list[tuple[int, int, int]]:
    """Segments of limbs, and the joints of the skeleton at the proximal joints of their parents and at
    theirs."""
    at = {}  # joint of the skeleton at the proximal joint of a segment
    for name, (segment, share) in model.keypoints.items():
        if name in joint_names and not np.any(share):
            at[model.index(segment)] = list(joint_names).index(name)
    return [
        (s, at[int(model.parents[s])], at[s])
        for s in at if int(model.parents[s]) in at and model.names[s][0] in "lr"
    ]  # fmt: skip
