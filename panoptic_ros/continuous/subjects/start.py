"""Degrees of freedom of a person at dense instants, from its joint curves: the start of a fit."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from panoptic_ros.continuous.curves import KnotGrid
from panoptic_ros.continuous.elhayek.body import first_poses, fit_poses, usable
from panoptic_ros.continuous.elhayek.skeleton import HingeSkeleton
from panoptic_ros.continuous.person import PersonCurve
from panoptic_ros.errors import DataError

Array = np.ndarray
INTERVAL_S = 0.02  # s between two poses
STEPS = 3  # Gauss-Newton steps from one pose to the next: a limb turns by less than 0.5 rad in between
LEAST_CERTAIN = 0.1  # m, greatest standard deviation of a joint that counts
WIDEST_MISS = 0.05  # m, mean miss of the joints above which a pose starts without the previous one
LONGEST_GAP_S = 0.2  # s without a usable instant after which a pose starts without the previous one
MIDDLE = 1.5  # knots by which the middle of a control point's influence is before that control point's index


def certain_joints(person: PersonCurve, instants: Array) -> Array:
    """Return the joints (T, J, 3) m of a person at instants (T,) s, NaN = not well known."""
    joints = person.at(instants)
    variances = np.trace(person.covariances_at(instants), axis1=-2, axis2=-1)
    joints[~(variances < LEAST_CERTAIN**2)] = np.nan
    return joints


def usable_instants(person: PersonCurve, names: Sequence[str]) -> Array:
    """Return the instants (T,) s, at least one, at which the joint curves of a person determine a pose.

    Raises:
        DataError: if there is none.
    """
    first, last = float(person.seen[0]), float(person.seen[-1])
    instants = np.append(np.arange(first, last, INTERVAL_S), last)
    good: Array = instants[usable(certain_joints(person, instants), names)]
    if not len(good):
        raise DataError(
            f"no view shows shoulders and hips of person {person.id}; curves of joint angles need them"
        )
    return good


def start_points(
    person: PersonCurve, skeleton: HingeSkeleton, names: Sequence[str], instants: Array
) -> Array:
    """Return control points (K, D) of curves near the poses of a person, on the knots of its joint curves.

    Args:
        instants: (T,) s, see `usable_instants`.
    """
    grid: KnotGrid = person.grid
    poses = poses_along(skeleton, names, certain_joints(person, instants), instants)
    middles = grid.origin + grid.step * (np.arange(grid.number) - MIDDLE)
    return np.stack([np.interp(middles, instants, values) for values in poses.T], axis=1)


def poses_along(skeleton: HingeSkeleton, names: Sequence[str], joints: Array, instants: Array) -> Array:
    """Return degrees of freedom (T, D) that follow joints (T, J, 3) m without jumps of angles.

    Each pose starts from the extrapolation of the previous two. It starts without them after a gap, or if the
    joints are far from it.
    """
    poses = np.zeros((len(instants), skeleton.freedoms))
    fresh, starts = True, []
    for t, here in enumerate(joints):
        pose = poses[t]
        if t and instants[t] - instants[t - 1] < LONGEST_GAP_S:
            slope = 0.0 if fresh else (poses[t - 1] - poses[t - 2]) / (instants[t - 1] - instants[t - 2])
            pose[:] = poses[t - 1] + slope * (instants[t] - instants[t - 1])
            pose[:] = fit_poses(skeleton, pose[None], here[None], STEPS)[0]
            miss = np.nanmean(np.linalg.norm(skeleton.joints(pose[None])[0] - here, axis=-1))
            fresh = bool(miss > WIDEST_MISS)
        else:
            fresh = True
        if fresh:
            starts.append(t)
            pose[:] = first_poses(skeleton, names, here[None])[0]
            turns = np.rint((poses[max(t - 1, 0), 3:] - pose[3:]) / (2.0 * np.pi))
            pose[3:] += 2.0 * np.pi * turns
    for first, last in pairwise([*starts, len(poses)]):
        bend_forward(skeleton, poses[first:last])
    return poses


def bend_forward(skeleton: HingeSkeleton, poses: Array) -> None:
    """Bend elbows and knees of poses (T, D) the way that their limits allow, in place.

    A limb that bends the other way, turned by half a turn about its upper bone, has the same joints. Which of
    both a fit finds is a matter of chance if the limb was stretched at first.
    """
    for bend in skeleton.bends:
        turn = bend - 1
        limits = skeleton.limits[[turn, bend]]
        own = poses[:, [turn, bend]]
        half = np.copysign(np.pi, limits[0].mean() - own[:, 0].mean())
        other = own * (1.0, -1.0) + (half, 0.0)
        before, after = (
            (np.maximum(values - limits[:, 1], 0.0) + np.maximum(limits[:, 0] - values, 0.0)).sum()
            for values in (own, other)
        )
        if after < before:
            poses[:, [turn, bend]] = other
