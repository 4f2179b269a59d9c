"""Errors of solved bodies against the truth: positions and orientations, global, root-relative,
Procrustes (4.1)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from panoptic_ros.domain.subjects import BodyState
from panoptic_ros.evaluation.ellipsoids import ELLIPSOID_95, squared_distances
from panoptic_ros.geometry.rotations import mean_rotation, vectors_of

Array = np.ndarray
STANDING_SPEED = 0.1  # m/s


def score_bodies(
    truth: Sequence[BodyState], found: Sequence[BodyState], parents: Array, skip_s: float,
    ground: Sequence[int] = (),
) -> dict[str, Any]:  # fmt: skip
    """Errors of one subject at the stamps that both have, after the first seconds.

    mm: of the joints, global, relative to the root, after the best rigid motion of each frame; deg: of the
    segments' orientations, plain, after one constant rotation of each segment, and relative to the parent;
    acc: m/s^2, of the joints' accelerations. Of the first: mean, median, std, MAD. drift_m: farthest that
    the root goes from where it was off at first; standing_drift_m: the same, of what is added while one of
    the joints `ground` truly stands.
    """
    theirs = {state.stamp_ns: state for state in found}
    begin = truth[0].stamp_ns + round(skip_s * 1e9)
    wanted = [state for state in truth if state.stamp_ns >= begin]
    pairs = [(state, theirs[state.stamp_ns]) for state in wanted if state.stamp_ns in theirs]
    if not pairs:
        return {"coverage": 0.0}
    places, mine = (np.array([p[k].places for p in pairs]) for k in (0, 1))
    frames, my_frames = (np.array([p[k].frames for p in pairs]) for k in (0, 1))
    apart = 1000 * np.linalg.norm(mine - places, axis=-1)
    relative = (mine - mine[:, :1]) - (places - places[:, :1])
    turned = my_frames.swapaxes(-1, -2) @ frames
    aligned = np.stack([mean_rotation(turned[:, s]).T @ turned[:, s] for s in range(turned.shape[1])], axis=1)
    children = np.flatnonzero(parents >= 0)
    local = [f[:, parents[children]].swapaxes(-1, -2) @ f[:, children] for f in (frames, my_frames)]
    degrees = _degrees(turned)
    step = (pairs[1][0].stamp_ns - pairs[0][0].stamp_ns) * 1e-9 if len(pairs) > 2 else 1.0
    jump = np.linalg.norm(np.diff(mine - places, 2, axis=0), axis=-1) / step**2
    return {
        "coverage": len(pairs) / len(wanted), **_summary("mm", apart), **_summary("deg", degrees),
        "root_mm": float(apart[:, 0].mean()),
        "relative_mm": 1000 * float(np.linalg.norm(relative, axis=-1).mean()),
        "procrustes_mm": 1000 * float(np.mean([_procrustes(a, b) for a, b in zip(mine, places)])),
        "aligned_deg": float(_degrees(aligned).mean()),
        "joint_deg": float(_degrees(local[1].swapaxes(-1, -2) @ local[0]).mean()),
        "acc": float(jump.mean()) if len(jump) else 0.0,
        "drift_m": _farthest(mine[:, 0] - places[:, 0], np.ones(len(pairs), bool)),
        "standing_drift_m": _farthest(mine[:, 0] - places[:, 0], _stands(places[:, list(ground)], step)),
    }  # fmt: skip


def inside(found: Sequence[BodyState], truth: Sequence[BodyState]) -> float:
    """Share of true joints that lie in the ellipsoids that are to hold 95 % of them; NaN without any."""
    true, shares = {state.stamp_ns: state for state in truth}, []
    for state in found:
        if state.covariances is not None and state.stamp_ns in true:
            off = state.places - true[state.stamp_ns].places
            squares = squared_distances(off, state.covariances[:, :3, :3])
            shares.append(float((squares < ELLIPSOID_95).mean()))
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
        name: float(values.mean()), f"{name}_median": middle, f"{name}_std": float(values.std()),
        f"{name}_mad": float(np.median(np.abs(values - middle))),
    }  # fmt: skip


def _degrees(rotations: Array) -> Array:
    vectors = vectors_of(np.ascontiguousarray(rotations.reshape(-1, 3, 3)))
    found: Array = np.degrees(np.linalg.norm(vectors, axis=-1)).reshape(rotations.shape[:-2])
    return found


def _procrustes(mine: Array, truth: Array) -> float:
    """Mean distance of joints, m, after the best rotation and shift."""
    a, b = mine - mine.mean(0), truth - truth.mean(0)
    u, _, v = np.linalg.svd(a.T @ b)
    turn = u @ np.diag([1.0, 1.0, np.linalg.det(u @ v)]) @ v
    return float(np.linalg.norm(a @ turn - b, axis=-1).mean())
