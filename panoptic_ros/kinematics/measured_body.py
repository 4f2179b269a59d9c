"""The body of somebody of whom nothing is known but skeletons: lengths from the first of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from panoptic_ros.domain.segments import SHORTEST, TALLEST, Body, SegmentModel

Array = np.ndarray
ASKED = 10  # skeletons with enough joints
LEAST_LIMBS = 5
ACROSS, ALONG = 1, 2  # axes of the trunk: to the left, upwards


class MeasuredBody:
    """Skeletons of one person, one by one."""

    def __init__(self) -> None:
        self._seen: list[Array] = []

    def take(self, model: SegmentModel, joint_names: Sequence[str], positions: Array) -> Body | None:
        """The body, once enough skeletons have told of it; positions (J, 3) m, NaN = missing.

        A limb is a segment whose proximal joint and whose parent's are joints of the skeleton. The stature is
        that which explains the limbs, by the median; limbs then have their own lengths, left as right, and so
        have the widths of shoulders and hips, the trunk between them, and how far apart eyes and ears are.
        """
        limbs = limbs_of(model, joint_names)
        if not len(limbs):
            return None
        if np.isfinite(_apart(positions[None], limbs)).sum() >= LEAST_LIMBS:
            self._seen.append(np.array(positions))
        if len(self._seen) < ASKED:
            return None
        seen = np.array(self._seen)
        typical = _typical(_apart(seen, limbs))
        shares = np.array([np.linalg.norm(model.shares[s]) for s, _, _ in limbs])
        known = np.isfinite(typical)
        stature = float(np.median(typical[known] / shares[known]))
        body = model.body(float(np.clip(stature, SHORTEST, TALLEST)))
        by_name: dict[str, list[float]] = {}
        for (s, _, _), length in zip(limbs, typical):
            if np.isfinite(length):
                by_name.setdefault(model.names[s][1:], []).append(float(length))
        offsets = _trunk(model, joint_names, body.offsets, seen)
        for s, _, _ in limbs:
            own = by_name.get(model.names[s][1:])
            if own:
                usual = body.offsets[s]
                offsets[s] = usual * (np.mean(own) / np.linalg.norm(usual))
        body = body.with_offsets(dict(zip(model.names, offsets)))
        return body.with_keypoints(_pairs_of(body, joint_names, seen))


def limbs_of(model: SegmentModel, joint_names: Sequence[str]) -> list[tuple[int, int, int]]:
    """Segments of limbs, and the joints of the skeleton at the proximal joints of their parents and at
    theirs."""
    at = _joints_at(model, joint_names)
    return [
        (s, at[int(model.parents[s])], at[s])
        for s in at if int(model.parents[s]) in at and model.names[s][0] in "lr"
    ]  # fmt: skip


def _joints_at(model: SegmentModel, joint_names: Sequence[str]) -> dict[int, int]:
    """The joint of the skeleton at the proximal joint of each segment that has one."""
    return {
        model.index(segment): list(joint_names).index(name)
        for name, (segment, share) in model.keypoints.items()
        if name in joint_names and not np.any(share)
    }


def _trunk(model: SegmentModel, joint_names: Sequence[str], usual: Array, seen: Array) -> Array:
    """Offsets (S, 3) m with the widths at which limbs sit on the trunk, and its length between them.

    Args:
        usual: (S, 3) m, those of the stature. seen: (N, J, 3) m.
    """
    offsets, at = usual.copy(), _joints_at(model, joint_names)
    middles = []  # of a pair of limbs, and the left one
    for s, joint in at.items():
        name, parent = model.names[s], int(model.parents[s])
        other = model.names.index(f"r{name[1:]}") if name[0] == "l" else -1
        if other not in at or int(model.parents[other]) != parent:
            continue
        both = seen[:, joint], seen[:, at[other]]
        width = _typical(np.linalg.norm(both[0] - both[1], axis=-1)[:, None])[0]
        if np.isfinite(width):
            offsets[[s, other], ACROSS] = 0.5 * width, -0.5 * width
        middles.append((s, other, 0.5 * (both[0] + both[1])))
    if len(middles) != 2:
        return offsets
    (s, _, above), (t, _, below) = middles
    between = set(_up(model, int(model.parents[s]))) ^ set(_up(model, int(model.parents[t])))
    parts = [*between, *(k for pair in middles for k in pair[:2])]
    length = _typical(np.linalg.norm(above - below, axis=-1)[:, None])[0]
    expected = abs(usual[s, ALONG] - usual[t, ALONG]) + sum(usual[k, ALONG] for k in between)
    if np.isfinite(length):
        offsets[parts, ALONG] *= length / expected
    return offsets


def _pairs_of(body: Body, joint_names: Sequence[str], seen: Array) -> dict[str, tuple[str, Array]]:
    """Joints of the detector that are in pairs on one segment, as far apart as in skeletons (N, J, 3) m."""
    found, columns = {}, {name: k for k, name in enumerate(joint_names)}
    for left, (segment, _) in body.keypoints.items():
        right = f"r{left[1:]}"
        if left[0] != "l" or right not in body.keypoints or body.keypoints[right][0] != segment:
            continue
        if left not in columns or right not in columns:
            continue
        apart = np.linalg.norm(seen[:, columns[left]] - seen[:, columns[right]], axis=-1)
        width = _typical(apart[:, None])[0]
        if np.isfinite(width):
            for name, side in ((left, 1.0), (right, -1.0)):
                place = np.array(body.keypoints[name][1])
                place[ACROSS] = 0.5 * side * width
                found[name] = (body.model.names[segment], place)
    return found


def _up(model: SegmentModel, segment: int) -> list[int]:
    """A segment and all that carry it."""
    found = []
    while segment >= 0:
        found.append(segment)
        segment = int(model.parents[segment])
    return found


def _apart(positions: Array, limbs: Sequence[tuple[int, int, int]]) -> Array:
    """Lengths (N, L) m of limbs in skeletons (N, J, 3)."""
    begin, end = np.array([b for _, b, _ in limbs]), np.array([e for _, _, e in limbs])
    found: Array = np.linalg.norm(positions[:, end] - positions[:, begin], axis=-1)
    return found


def _typical(values: Array) -> Array:
    """Medians (L,) of what is known of (N, L); NaN where nothing is."""
    found = np.full(values.shape[1], np.nan)
    for k, column in enumerate(values.T):
        known = column[np.isfinite(column)]
        if len(known):
            found[k] = np.median(known)
    return found
