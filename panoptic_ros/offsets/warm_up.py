"""An example to compile the kernels with, so that no block waits for it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from panoptic_ros.domain import Rig, SkeletonModel, TrackedPoseSet
from panoptic_ros.domain.rig_arrays import RigArrays
from panoptic_ros.offsets.association import associate
from panoptic_ros.offsets.estimate import fit_clocks
from panoptic_ros.offsets.frames import camera_frames
from panoptic_ros.offsets.tracks import Tracks
from panoptic_ros.solving.example import cloud_of_joints, easy_instants

STEP_NS = 33_000_000
FRAMES = 15  # enough rays for a trajectory


def compile_kernels(rig: Rig, skeleton: SkeletonModel, arrays: RigArrays, prior: np.ndarray) -> None:
    """Fit the clocks to somebody who does not move, which takes all kernels; or take them from the cache.

    Args:
        prior: standard deviations (2C,) of the clocks, see `fit_clocks`.
    """
    first = next(iter(easy_instants(rig, skeleton)))
    sets = [
        replace(first, views=tuple(replace(view, stamp_ns=k * STEP_NS) for view in first.views))
        for k in range(FRAMES)
    ]
    frames = camera_frames(sets, arrays, skeleton)
    stamps = np.array([1e-9 * frame.stamp_ns for frame in frames])
    tracked = [_tracked(k, cloud_of_joints(rig, skeleton), skeleton) for k in range(FRAMES)]
    seen = associate(frames, stamps, stamps, Tracks(tracked, 0), arrays, skeleton, 0.1)
    fit_clocks(seen, len(rig), np.zeros(len(rig)), np.zeros(len(rig)), prior)


def _tracked(index: int, joints: np.ndarray, skeleton: SkeletonModel) -> TrackedPoseSet:
    ones = np.ones((1, len(joints)))
    spread = np.tile(1e-4 * np.eye(3), (1, len(joints), 1, 1))
    return TrackedPoseSet(
        index,
        index * STEP_NS,
        skeleton.hash,
        joints[None],
        spread,
        ones,
        2 * ones,
        ones,
        np.ones(1),
        ids=np.array([0]),
    )
