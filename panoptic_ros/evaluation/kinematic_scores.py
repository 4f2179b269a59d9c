"""Errors of solved bodies against the ground truth.

Positions and orientations are compared in the global frame, relative to the root, and after Procrustes
alignment (4.1).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from panoptic_ros.domain.segments import SegmentModel
from panoptic_ros.domain.subjects import BodyState
from panoptic_ros.evaluation.ellipsoids import ELLIPSOID_95, squared_distances
from panoptic_ros.geometry.rotations import mean_rotation, vectors_of

Array = np.ndarray
STANDING_SPEED = 0.1  # m/s; speed below which a joint stands


def score_bodies(
    truth: Sequence[BodyState],
    found: Sequence[BodyState],
    parents: Array,
    skip_s: float,
    ground: Sequence[int] = (),
) -> dict[str, Any]:
    """Return the errors of one subject at common timestamps, after the first `skip_s` seconds.

    Only segments that the truth has count; the other truth segments are NaN.

    mm: Joint position errors, global. They are also given relative to the root (relative) and after the best
    rigid motion of each frame (procrustes). A further variant removes one constant offset of each joint in
    its segment's frame (aligned).

    deg: Segment orientation errors, global. They are also given after the same rigid motion (procrustes),
    without one constant rotation of each segment (aligned), and relative to the parent (joint). All of these
    have mean, median, standard deviation and MAD (4.1).

    acc: Mean error of the joint accelerations, m/s^2. drift_m: Largest distance of the root error from its
    initial value. standing_drift_m: The same for the part of the error added while one of the joints `ground`
    truly stands.
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
    """Return the errors `angle_deg` of all joint angles at common timestamps.

    The first `skip_s` seconds are excluded. Errors are given as mean, median, standard deviation and MAD.
    Where the middle one of three angles is near 90 deg, the other two are hardly defined.
    """
    begin, theirs = truth[0].stamp_ns + round(skip_s * 1e9), {state.stamp_ns: state for state in found}
    pairs = [(s, theirs[s.stamp_ns]) for s in truth if s.stamp_ns >= begin and s.stamp_ns in theirs]
    if not pairs:
        return {}
    angles = [model.joint_angles(np.array([pair[k].frames for pair in pairs])) for k in (0, 1)]
    apart = (angles[1] - angles[0] + np.pi) % (2.0 * np.pi) - np.pi
    return _summary("angle_deg", np.degrees(np.abs(apart[:, np.isfinite(apart).all(0)])))


def _whole(states: Sequence[BodyState]) -> list[int]:
    """Return the segments that are finite at all instants."""
    places, frames = (np.array([getattr(s, name) for s in states]) for name in ("places", "frames"))
    kept = np.isfinite(places).all((0, 2)) & np.isfinite(frames).all((0, 2, 3))
    found: list[int] = np.flatnonzero(kept).tolist()
    return found


def inside(found: Sequence[BodyState], truth: Sequence[BodyState]) -> float:
    """Return the share of true joints inside the estimated 95 % ellipsoids; NaN without any."""
    true, shares = {state.stamp_ns: state for state in truth}, []
    for state in found:
        if state.covariances is not None and state.stamp_ns in true:
            off = state.places - true[state.stamp_ns].places
            squares = squared_distances(off, state.covariances[:, :3, :3])
            shares.append(float((squares[np.isfinite(squares)] < ELLIPSOID_95).mean()))
    return float(np.mean(shares)) if shares else float("nan")


def _stands(joints: Array, step: float) -> Array:
    """Return a mask (T,) of instants at which any joint (T, G, 3) is slow since the previous instant."""
    speeds = np.linalg.norm(np.diff(joints, axis=0, prepend=joints[:1]), axis=-1) / step
    found: Array = (speeds < STANDING_SPEED).any(-1)
    return found


def _farthest(errors: Array, counted: Array) -> float:
    """Return the largest distance (m) that errors (T, 3) cover in the counted steps (T,)."""
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
    """Return distances (T, J) after the best rigid motion of each frame, and its rotations (T, 3, 3)."""
    a, b = mine - mine.mean(1, keepdims=True), truth - truth.mean(1, keepdims=True)
    u, _, v = np.linalg.svd(b.swapaxes(-1, -2) @ a)
    signs = np.ones((len(a), 3))
    signs[:, 2] = np.linalg.det(u @ v)
    turns = (u * signs[:, None]) @ v
    return np.linalg.norm(a @ turns.swapaxes(-1, -2) - b, axis=-1), turns
