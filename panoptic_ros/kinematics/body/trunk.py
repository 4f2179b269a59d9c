"""Where pelvis and neck begin in motion of hips and shoulders, by the proportions of the skeleton."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from panoptic_ros.domain.segments import SegmentModel
from panoptic_ros.kinematics.body.fitting import Site

Array = np.ndarray
HIPS, SHOULDERS = ("lThigh", "rThigh"), ("lUpperArm", "rUpperArm")
BETWEEN = {"hips": HIPS, "neck": SHOULDERS}


def with_trunk(
    model: SegmentModel, sites: Mapping[str, Site], names: Sequence[str], joints: Array
) -> tuple[tuple[str, ...], Array]:
    """Names, and joints (T, J, 3) m, with the beginnings of hips and neck where these are not there.

    Each lies off the middle of hips or shoulders, along the trunk, as far as in the T posture in proportion
    to the distance between these two.

    Args:
        sites: where joints lie, by name.
    """
    begins = {name: model.names[site.segment] for name, site in sites.items() if not np.any(site.share)}
    begun = {begins[name]: k for k, name in enumerate(names) if name in begins}
    if any(segment not in begun for segment in (*HIPS, *SHOULDERS)):
        return tuple(names), joints
    middles = [sum(joints[:, begun[segment]] for segment in pair) / 2.0 for pair in (HIPS, SHOULDERS)]
    up = middles[1] - middles[0]
    up /= np.linalg.norm(up, axis=-1, keepdims=True)
    heights, found, added = _t_posture(model), list(names), [joints]
    for (segment, pair), middle in zip(BETWEEN.items(), middles):
        if segment in begun:
            continue
        one, other = (heights[model.index(end)] for end in pair)
        above = heights[model.index(segment), 2] - (one + other)[2] / 2.0
        apart = np.linalg.norm(joints[:, begun[pair[0]]] - joints[:, begun[pair[1]]], axis=-1)
        length = above / np.linalg.norm(one - other) * np.nanmedian(apart)
        found.append(next(name for name, owner in begins.items() if owner == segment))
        added.append((middle + length * up)[:, None])
    return tuple(found), np.concatenate(added, axis=1)


def _t_posture(model: SegmentModel) -> Array:
    """Places (S, 3) of the joints in a T, shares of the stature."""
    places = model.body(1.0).offsets.copy()
    for s, parent in enumerate(model.parents):
        if parent >= 0:
            places[s] += places[parent]
    return places
