"""Solved bodies at the instants of skeletons: how well they fit images, keep limits and hold still."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from panoptic_ros.domain import DetectionSet, JointState, TrackedPoseSet
from panoptic_ros.domain.bodies import BodyStateSet
from panoptic_ros.domain.segments import SegmentModel
from panoptic_ros.evaluation.capture_report import reprojection_errors, typical_acceleration
from panoptic_ros.stage import StageContext

Array = np.ndarray
REACH_NS = 60_000_000  # between a skeleton and the bodies on both sides of it
BEYOND = np.radians(5.0)  # limits, which are as soft as `limit_sd`


def both_at(
    skeletons: Sequence[TrackedPoseSet], bodies: Sequence[BodyStateSet]
) -> tuple[list[TrackedPoseSet], list[TrackedPoseSet]]:
    """Skeletons of those who have a body, and the same with the joints of their bodies."""
    own: dict[int, tuple[list[int], list[Array]]] = {}
    for solved in bodies:
        for number, joints in zip(solved.ids.tolist(), solved.keypoints):
            stamps, found = own.setdefault(number, ([], []))
            stamps.append(solved.stamp_ns)
            found.append(joints)
    plain, posed = [], []
    for item in skeletons:
        placed = {n: _between(*own[n], item.stamp_ns) for n in item.ids.tolist() if n in own}
        rows = [k for k, n in enumerate(item.ids.tolist()) if placed.get(n) is not None]
        plain.append(_chosen(item, rows, item.positions[rows]))
        points = [placed[int(item.ids[k])] for k in rows]
        posed.append(_chosen(item, rows, np.array(points).reshape(len(rows), *item.positions.shape[1:])))
    return plain, posed


def body_summary(
    context: StageContext,
    sets: Sequence[DetectionSet],
    bodies: Sequence[BodyStateSet],
    both: tuple[Sequence[TrackedPoseSet], Sequence[TrackedPoseSet]],
) -> dict[str, Any]:
    """Of skeletons and of bodies: reprojection errors, px, of joints that skeletons measured (median, 90 %),
    and accelerations, m/s^2; of bodies, what is beyond their joint limits."""
    pixels, accelerations = [], []
    for poses in both:
        errors = reprojection_errors(context.rig, context.skeleton, poses, sets).px
        pixels.append([float(np.percentile(errors, q)) for q in (50, 90)] if len(errors) else [np.nan] * 2)
        found = []
        for number in sorted({n for pose in poses for n in pose.ids.tolist()}):
            there = [(p, p.ids.tolist().index(number)) for p in poses if number in p.ids.tolist()]
            stamps = np.array([p.stamp_ns for p, _ in there])
            found.append(typical_acceleration(stamps, np.array([p.positions[k] for p, k in there])))
        accelerations.append(float(np.nanmean(found)) if found else np.nan)
    return {
        "px": [row[0] for row in pixels],
        "px_90": [row[1] for row in pixels],
        "acceleration": accelerations,
        **_limits(context.extras["segments"], bodies),
    }


def _limits(model: SegmentModel, bodies: Sequence[BodyStateSet]) -> dict[str, float]:
    freedoms = np.concatenate([item.freedoms for item in bodies if len(item.ids)] or [np.zeros((0, 6))])
    if not len(freedoms):
        return {"beyond": float("nan"), "most_deg": float("nan")}
    turns = freedoms[:, 6:].reshape(len(freedoms), -1, 3)
    over = np.maximum(model.lower[1:] - turns, turns - model.upper[1:])
    return {
        "beyond": float((over > BEYOND).mean()),
        "most_deg": float(max(np.degrees(over.max()), 0.0)),
    }


def _between(stamps: Sequence[int], found: Sequence[Array], stamp_ns: int) -> Array | None:
    """Joints (J, 3) m at an instant; None where there is no body about then."""
    after = min(int(np.searchsorted(stamps, stamp_ns)), len(stamps) - 1)
    before = max(after - 1, 0) if stamps[after] > stamp_ns else after
    if max(abs(stamps[k] - stamp_ns) for k in (before, after)) > REACH_NS:
        return None
    gap = stamps[after] - stamps[before]
    share = (stamp_ns - stamps[before]) / gap if gap else 0.0
    joints: Array = (1.0 - share) * found[before] + share * found[after]
    return joints


def _chosen(item: TrackedPoseSet, rows: list[int], positions: Array) -> TrackedPoseSet:
    """Some people of an instant, with these joints (P, J, 3) where they have any."""
    there = (item.states[rows] != JointState.MISSING) & np.isfinite(positions).all(-1)
    return TrackedPoseSet(
        item.index,
        item.stamp_ns,
        item.skeleton_hash,
        np.where(there[..., None], positions, np.nan),
        np.where(there[..., None, None], item.covariances[rows], np.nan),
        np.where(there, item.scores[rows], 0.0),
        item.views[rows],
        np.where(there, item.states[rows], JointState.MISSING),
        item.person_scores[rows],
        ids=item.ids[rows],
    )
