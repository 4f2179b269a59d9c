"""Trains the pose prior from recorded motion or from our own results."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from panoptic_ros.domain.segments import SegmentModel
from panoptic_ros.errors import DataError, UsageError
from panoptic_ros.geometry.rotations import vectors_of
from panoptic_ros.io.body_files import read_bodies
from panoptic_ros.io.body_models import DEFAULT_MODEL, read_body_model
from panoptic_ros.io.c3d_motion import read_c3d
from panoptic_ros.io.motion_files import (
    JointTrajectories,
    named_plainly,
    read_bvh,
    read_clip_arrays,
    read_sites,
)
from panoptic_ros.io.pose_prior import write_prior
from panoptic_ros.io.recorded_motions import read_clips
from panoptic_ros.kinematics.body.fitting import fit_motion, with_trunk
from panoptic_ros.kinematics.pose.prior import other_sides, train_prior
from panoptic_ros.stage import Progress

Array = np.ndarray
RATE = 30.0  # Hz, maximum rate of the poses used; motion recorded at a higher rate is subsampled
WORST = 0.05  # m, RMS residual above which a motion does not fit


def train_from_files(
    paths: Sequence[Path],
    out: Path,
    leave_out: Sequence[str],
    unit: float,
    progress: Progress,
    segments: str = DEFAULT_MODEL,
) -> list[str]:
    """Train a pose prior on all motions of the files and write it.

    Args:
        leave_out: names of clips to exclude.
        unit: unit of BVH files, m.
        segments: name or file of the segment model (skeleton).

    Returns:
        a line about each motion, and one about the prior.

    Raises:
        UserError: if a file is invalid, or no motion is left.
    """
    model = read_body_model(segments)
    poses: list[Array] = []
    lines = []
    for n, path in enumerate(paths):
        progress(n / len(paths), path.name)
        for name, vectors, told in _motions(path, model, unit):
            if name in leave_out:
                continue
            poses.append(vectors)
            lines.append(f"{path.name}: {name}: {len(vectors)} poses{told}")
    if not poses:
        raise UsageError("no motion is left to train on; give other files, or leave out less")
    found = train_prior(np.concatenate(poses), other_sides(model.names))
    write_prior(out, found, model)
    progress(1.0, "done")
    return [*lines, f"{out}: {found.components.shape[1]} components"]


def _motions(path: Path, model: SegmentModel, unit: float) -> list[tuple[str, Array, str]]:
    """Return name, rotation vectors (T, S, 3) and a text about the fit for each motion of a file."""
    if path.name.endswith((".json", ".json.gz")):
        return [_own_result(path, model)]
    if path.suffix.lower() == ".npz" and (clips := read_clips(path)):
        if model.names != read_body_model().names:
            raise UsageError(f"{path} has poses of {DEFAULT_MODEL}; priors of others need joints: .bvh, .c3d")
        return [(name, clip.vectors, "") for name, clip in clips.items()]
    sites = read_sites(model)
    if path.suffix.lower() == ".bvh":
        motions = [read_bvh(path, unit)]
    elif path.suffix.lower() == ".c3d":
        motions = [read_c3d(path)]
    elif path.suffix.lower() == ".npz":
        motions = read_clip_arrays(path)
    else:
        raise UsageError(f"{path}: motion is read from .bvh, .c3d, .npz and kinematics.json.gz")
    return [_fitted(path, motion, model, named_plainly(motion, sites)) for motion in motions]


def _fitted(
    path: Path, motion: JointTrajectories, model: SegmentModel, named: JointTrajectories
) -> tuple[str, Array, str]:
    every, sites = max(int(motion.rate / RATE), 1), read_sites(model)
    try:
        names, joints = with_trunk(model, sites, named.joint_names, named.joints[::every])
        fit = fit_motion(model, sites, names, joints)
    except DataError as error:
        raise DataError(f"{path}: {motion.name}: {error}") from None
    if fit.residual > WORST:
        bvh = path.suffix.lower() == ".bvh"
        remedy = "give the unit of the file in metres, --unit" if bvh else "are these centres of joints?"
        raise DataError(
            f"{path}: {motion.name}: joints are {1e3 * fit.residual:.0f} mm off the skeleton; {remedy}"
        )
    return motion.name, fit.vectors, f", joints {1e3 * fit.residual:.0f} mm off"


def _own_result(path: Path, model: SegmentModel) -> tuple[str, Array, str]:
    names, states = read_bodies(path)
    if names != model.names or not states:
        raise DataError(f"{path} has no bodies with the {len(model.names)} segments of the skeleton")
    frames = np.array([state.frames for state in states])
    turns = frames.copy()
    children = np.flatnonzero(model.parents >= 0)
    turns[:, children] = frames[:, model.parents[children]].swapaxes(-1, -2) @ frames[:, children]
    vectors = vectors_of(np.ascontiguousarray(turns.reshape(-1, 3, 3))).reshape(*turns.shape[:2], 3)
    return path.name.split(".")[0], vectors, ""
