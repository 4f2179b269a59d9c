"""Errors of solved bodies against the truth: positions and orientations, global, root-relative,
Procrustes (4.1)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from panoptic_ros.domain.segments import SegmentModel
from panoptic_ros.domain.subjects import BodyState
from panoptic_ros.evaluation.ellipsoids import ELLIPSOID_95, squared_distances
from panoptic_ros.geometry.rotations import mean_rotation, vectors_of

Array = np.ndarray
STANDING_SPEED = 0.1  # m/s


def score_bodies(
    truth: Sequence[BodyState],
    found: Sequence[BodyState],
    parents: Array,
    skip_s: float,
    ground: Sequence[int] = (),
) -> dict[str, Any]:
    """Errors of one subject at the stamps that both have, after the first seconds, of the segments that the
    truth has (others are NaN there).

    mm: of the joints, global, relative to the root, after the best rigid motion of each frame (procrustes),
    and without one constant offset of each joint in its segment's frame (aligned); deg: of the segments'
    orientations, global, after the same motion, without one constant rotation of each segment, and
    relative to the parent; of all of these mean, median, std and MAD (4.1). acc: m/s^2, of the joints'
    accelerations. drift_m: farthest that the root goes from where it was off at first; standing_drift_m:
    the same, of what is added while one of the joints `ground` truly stands.
    """
    theirs = {state.stamp_ns: state for state in found}
    begin = truth[0].stamp_ns + round(skip_s * 1e9)
    wanted = [state for state in truth if state.stamp_ns >= begin]
    pairs = [(state, theirs[state.stamp_ns]) for state in wanted if state.stamp_ns in theirs]
    if not pairs:
        return {"coverage": 0.0}
    there = _whole([state for state, _ in pairs])
    places, mine = (np.array([p[k].places[there] for p in pairs]) for k in (0, 1))
    frames, my_frames = (np.array([p[k].frames for p in pairs]) for k in (0, 1))
    children = [s for s in there if parents[s] in there]
    local = [f[:, parents[children]].swapaxes(-1, -2) @ f[:, children] for f in (frames, my_frames)]
    frames, my_frames = frames[:, there], my_frames[:, there]
    apart = np.linalg.norm(mine - places, axis=-1)
    relative = (mine - mine[:, :1]) - (places - places[:, :1])
    turned = my_frames.swapaxes(-1, -2) @ frames
    aligned = np.stack([mean_rotation(turned[:, s]).T @ turned[:, s] for s in range(turned.shape[1])], axis=1)
    within = (frames.swapaxes(-1, -2) @ (mine - places)[..., None])[..., 0]
    fitted, turns = _procrustes(mine, places)
    step = (pairs[1][0].stamp_ns - pairs[0][0].stamp_ns) * 1e-9 if len(pairs) > 2 else 1.0
    stood = _stands(places[:, [there.index(s) for s in ground if s in there]], step)
    jump = np.linalg.norm(np.diff(mine - places, 2, axis=0), axis=-1) / step**2
    return {
        "coverage": len(pairs) / len(wanted),
        **_summary("mm", 1000 * apart),
        "root_mm": 1000 * float(apart[:, 0].mean()),
        **_summary("relative_mm", 1000 * np.linalg.norm(relative, axis=-1)),
        **_summary("procrustes_mm", 1000 * fitted),
        **_summary("aligned_mm", 1000 * np.linalg.norm(within - within.mean(0), axis=-1)),
        **_summary("deg", _degrees(turned)),
        **_summary("procrustes_deg", _degrees((turns[:, None] @ my_frames).swapaxes(-1, -2) @ frames)),
        **_summary("aligned_deg", _degrees(aligned)),
        **_summary("joint_deg", _degrees(local[1].swapaxes(-1, -2) @ local[0])),
        "acc": float(jump.mean()) if len(jump) else 0.0,
        "drift_m": _farthest(mine[:, 0] - places[:, 0], np.ones(len(pairs), bool)),
        "standing_drift_m": _farthest(mine[:, 0] - places[:, 0], stood),
    }


def score_joint_angles(
    truth: Sequence[BodyState], found: Sequence[BodyState], model: SegmentModel, skip_s: float
) -> dict[str, float]:
    """`angle_deg`: errors of all joint angles at the stamps that both have, after the first seconds: mean,
    median, std, MAD. Where the middle one of three is near 90 deg, the other two are hardly defined."""
    begin, theirs = truth[0].stamp_ns + round(skip_s * 1e9), {state.stamp_ns: state for state in found}
    pairs = [(s, theirs[s.stamp_ns]) for s in truth if s.stamp_ns >= begin and s.stamp_ns in theirs]
    if not pairs:
        return {}
    angles = [model.joint_angles(np.array([pair[k].frames for pair in pairs])) for k in (0, 1)]
    apart = (angles[1] - angles[0] + np.pi) % (2.0 * np.pi) - np.pi
    return _summary("angle_deg", np.degrees(np.abs(apart[:, np.isfinite(apart).all(0)])))


def _whole(states: Sequence[BodyState]) -> list[int]:
    """Segments that are there at all instants."""
    places, frames = (np.array([getattr(s, name) for s in states]) for name in ("places", "frames"))
    kept = np.isfinite(places).all((0, 2)) & np.isfinite(frames).all((0, 2, 3))
    found: list[int] = np.flatnonzero(kept).tolist()
    return found


def inside(found: Sequence[BodyState], truth: Sequence[BodyState]) -> float:
    """Share of true joints that lie in the ellipsoids that are to hold 95 % of them; NaN without any."""
    true, shares = {state.stamp_ns: state for state in truth}, []
    for state in found:
        if state.covariances is not None and state.stamp_ns in true:
            off = state.places - true[state.stamp_ns].places
            squares = squared_distances(off, state.covariances[:, :3, :3])
            shares.append(float((squares[np.isfinite(squares)] < ELLIPSOID_95).mean()))
    return float(np.mean(shares)) if shares else float("nan")


def _stands(joints: Array, step: float) -> Array:
    """Whether (T,) one of the joints (T, G, 3) is slow since the instant before."""
    speeds = np.linalg.norm(np.diff(joints, axis=0, prepend=joints[:1]), axis=-1) / step
    found: Array = (speeds < STANDING_SPEED).any(-1)
    return found


def _farthest(errors: Array, counted: Array) -> float:
    """m, that errors (T, 3) go in the steps that are counted (T,)."""
    steps = np.where(counted[1:, None], np.diff(errors, axis=0), 0.0)
    return float(np.linalg.norm(np.cumsum(steps, axis=0), axis=-1).max(initial=0.0))


def _summary(name: str, values: Array) -> dict[str, float]:
    middle = float(np.median(values))
    return {
        name: float(values.mean()),
        f"{name}_median": middle,
        f"{name}_std": float(values.std()),
        f"{name}_mad": float(np.median(np.abs(values - middle))),
    }


def _degrees(rotations: Array) -> Array:
    vectors = vectors_of(np.ascontiguousarray(rotations.reshape(-1, 3, 3)))
    found: Array = np.degrees(np.linalg.norm(vectors, axis=-1)).reshape(rotations.shape[:-2])
    return found


def _procrustes(mine: Array, truth: Array) -> tuple[Array, Array]:
    """Distances (T, J) after the best rotation and shift of each frame, and these rotations (T, 3, 3)."""
    a, b = mine - mine.mean(1, keepdims=True), truth - truth.mean(1, keepdims=True)
    u, _, v = np.linalg.svd(b.swapaxes(-1, -2) @ a)
    signs = np.ones((len(a), 3))
    signs[:, 2] = np.linalg.det(u @ v)
    turns = (u * signs[:, None]) @ v
    return np.linalg.norm(a @ turns.swapaxes(-1, -2) - b, axis=-1), turns
