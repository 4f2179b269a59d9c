"""HingeSkeleton of one person, and poses at single instants, from joint positions.

The paper estimates the skeleton of an actor beforehand. Here the lengths of the default skeleton are scaled
to the person, then each bone is fitted to positions of the joint curves at some instants.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from panoptic_ros.continuous.elhayek.skeleton import HingeSkeleton, skeleton_of
from panoptic_ros.domain.segments import SHORTEST, TALLEST, SegmentModel
from panoptic_ros.errors import DataError
from panoptic_ros.geometry.torso import torso_frames

Array = np.ndarray
INSTANTS = 50  # number of instants that determine the lengths
ROUNDS = 30  # number of fits of poses and lengths in turn
STEPS, ROUND_STEPS = 40, 2  # Gauss-Newton steps of a pose fit, alone and in a round
SIGMA = 0.02  # m, scale of the robust weights
PULL = 1e-3  # 1/rad^2 relative to a lever of 1 m: keeps undetermined angles near those of the start
ARMS_DEG = (0.0, 60.0, -60.0)  # elevations of the upper arms at which a pose fit starts
CORNERS = ("lShoulder", "rShoulder", "lHip", "rHip")
USUAL_STATURE = 1.7  # m
LEAST_JOINTS = 8  # minimum number of joints of an instant that serves


def skeleton_from(model: SegmentModel, names: Sequence[str], joints: Array) -> HingeSkeleton:
    """Return the skeleton of a person.

    Args:
        names: (J) names of the detector's joints.
        joints: (T, J, 3) m at usable instants, NaN = missing.
    """
    skeleton = skeleton_of(model.body(_stature(model, names, joints)), names)
    chosen = _some(joints)
    freedoms = first_poses(skeleton, names, chosen)
    for _ in range(ROUNDS):
        skeleton = _with_fitted_lengths(skeleton, freedoms, chosen)
        freedoms = fit_poses(skeleton, freedoms, chosen, ROUND_STEPS)
    return skeleton


def _some(joints: Array) -> Array:
    """Return up to `INSTANTS` of the instants of joints (T, J, 3)."""
    chosen: Array = joints[np.linspace(0, len(joints) - 1, min(INSTANTS, len(joints))).round().astype(int)]
    return chosen


def usable(joints: Array, names: Sequence[str]) -> Array:
    """Return whether instants (T,) of joints (T, J, 3) m show enough of a person to start from.

    Raises:
        DataError: if the detector has no shoulders or hips.
    """
    known = np.isfinite(joints).all(-1)
    found: Array = known[:, _corners(names)].all(1) & (known.sum(1) >= LEAST_JOINTS)
    return found


def first_poses(skeleton: HingeSkeleton, names: Sequence[str], joints: Array) -> Array:
    """Return degrees of freedom (T, D) that fit joints (T, J, 3) m best, without a previous pose.

    Args:
        joints: usable instants, see `usable`.
    """
    corners = joints[:, _corners(names)]
    frames = np.nan_to_num(torso_frames(corners)[0], nan=0.0)
    frames[~frames.any(axis=(1, 2))] = np.eye(3)
    start = np.zeros((len(joints), skeleton.freedoms))
    start[:, :3] = corners[:, 2:].mean(1)
    start[:, 3] = np.arctan2(frames[:, 1, 0], frames[:, 0, 0])  # R = Rz Ry Rx
    start[:, 4] = np.arcsin(np.clip(-frames[:, 2, 0], -1.0, 1.0))
    start[:, 5] = np.arctan2(frames[:, 2, 1], frames[:, 2, 2])
    start[:, 3] = np.unwrap(start[:, 3])
    best, least = start, np.full(len(joints), np.inf)
    for elevation in ARMS_DEG:
        tried = start.copy()
        tried[:, skeleton.elevations] = np.radians(elevation)
        tried = fit_poses(skeleton, tried, joints, STEPS)
        cost = _costs(skeleton, tried, joints)
        better = cost < least
        best = np.where(better[:, None], tried, best)
        least = np.minimum(cost, least)
    return best


def fit_poses(skeleton: HingeSkeleton, start: Array, joints: Array, steps: int = STEPS) -> Array:
    """Return degrees of freedom (T, D) near `start` (T, D) that fit joints (T, J, 3) m, NaN = missing."""
    found = start.copy()
    eye = PULL * np.eye(skeleton.freedoms)
    seen = skeleton.seen
    for _ in range(steps):
        points, slopes = skeleton.moved(found, skeleton.site_segments[seen], skeleton.site_offsets[seen])
        gaps = joints[:, seen] - points
        weights = 1.0 / (1.0 + (np.nan_to_num(gaps) ** 2).sum(-1) / SIGMA**2) * np.isfinite(gaps).all(-1)
        flat = slopes.reshape(len(found), -1, skeleton.freedoms)
        weighted = (slopes * weights[..., None, None]).reshape(flat.shape)
        matrix = weighted.swapaxes(1, 2) @ flat + eye
        right = weighted.swapaxes(1, 2) @ np.nan_to_num(gaps).reshape(len(found), -1, 1)
        step = np.linalg.solve(matrix, right)[..., 0]
        longest = np.abs(step[:, 3:]).max(axis=1, keepdims=True)
        found += step * np.minimum(1.0, 0.5 / np.maximum(longest, 1e-9))
    return found


def _costs(skeleton: HingeSkeleton, freedoms: Array, joints: Array) -> Array:
    """Return the robust costs (T,) of poses, with those of angles beyond their limits."""
    gaps = skeleton.joints(freedoms) - joints
    beyond = np.maximum(skeleton.limits[:, 0] - freedoms, 0.0) + np.maximum(
        freedoms - skeleton.limits[:, 1], 0.0
    )
    costs: Array = np.nansum(np.log1p((gaps**2).sum(-1) / SIGMA**2), axis=1) + (beyond**2).sum(1)
    return costs


def _with_fitted_lengths(skeleton: HingeSkeleton, freedoms: Array, joints: Array) -> HingeSkeleton:
    """Return the skeleton with each bone fitted to the joints (T, J, 3) m, as a median over instants.

    A joint at the origin of a segment determines that origin in the frame of the parent. Another joint
    determines its own place in the frame of its segment.
    """
    placed = skeleton.place(freedoms)
    offsets, sites = skeleton.offsets.copy(), skeleton.site_offsets.copy()
    for j in skeleton.seen:
        s = int(skeleton.site_segments[j])
        origin = not skeleton.site_offsets[j].any() and skeleton.parents[s] >= 0
        frame = int(skeleton.parents[s]) if origin else s
        arms = (joints[:, j] - placed.places[:, frame])[..., None]
        local = (placed.frames[:, frame].swapaxes(1, 2) @ arms)[..., 0]
        known = local[np.isfinite(local).all(1)]
        if len(known):
            (offsets if origin else sites)[s if origin else j] = np.median(known, axis=0)
    return replace(skeleton, offsets=offsets, site_offsets=sites)


def _stature(model: SegmentModel, names: Sequence[str], joints: Array) -> float:
    """Return the stature (m) that the lengths of limbs indicate; the default where there is none."""
    at = {
        segment: names.index(name)
        for name, (segment, share) in model.keypoints.items()
        if name in names and not share.any()
    }
    ratios = []
    for segment, j in at.items():
        parent = model.names[model.parents[model.index(segment)]]
        if parent in at:
            length = np.nanmedian(np.linalg.norm(joints[:, j] - joints[:, at[parent]], axis=-1))
            ratios.append(length / np.linalg.norm(model.shares[model.index(segment)]))
    known = [ratio for ratio in ratios if np.isfinite(ratio)]
    return float(np.clip(np.median(known), SHORTEST, TALLEST)) if known else USUAL_STATURE


def _corners(names: Sequence[str]) -> list[int]:
    """Return the indices of shoulders and hips.

    Raises:
        DataError: if the detector lacks one of them.
    """
    missing = [name for name in CORNERS if name not in names]
    if missing:
        raise DataError(f"the preset needs the joints {', '.join(CORNERS)}; the file lacks {missing[0]}")
    return [list(names).index(name) for name in CORNERS]
