"""Conversion of solved bodies to the published record.

Constant biases of a detector and errors of the calibration are the same at every instant, so no filter
observes them. They are therefore added to the covariances of positions here, as refinement adds them to
those of skeletons. For the calibration, all cameras that see a point count.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from panoptic_ros.domain import SkeletonModel
from panoptic_ros.domain.bodies import BodyStateSet
from panoptic_ros.domain.segments import SegmentedBody, SegmentModel
from panoptic_ros.domain.subjects import BodyState
from panoptic_ros.geometry.rotations import to_quaternions, vectors_of
from panoptic_ros.kernels import njit
from panoptic_ros.solving.calibration_errors import CalibrationErrors

Array = np.ndarray


class SolvedBody(NamedTuple):
    """Body of a person at an instant, and the data from which it was solved.

    Attributes:
        state, body: Solved state, and lengths of the person.
        source, views, devices: `BodySource`, number of cameras, number of devices.
    """

    state: BodyState
    body: SegmentedBody
    source: int
    views: int
    devices: int


def body_set(
    index: int,
    stamp_ns: int,
    newest_ns: int,
    model: SegmentModel,
    skeleton: SkeletonModel,
    bodies: Sequence[SolvedBody],
    calibration: CalibrationErrors | None = None,
) -> BodyStateSet:
    """Return the record of an instant, with bodies in the order of their ids.

    Args:
        model: Skeleton of segments of all bodies.
        skeleton: Skeleton whose joints are the keypoints.
        calibration: Errors of the rig's calibration; None = unknown.
    """
    rows = sorted(bodies, key=lambda row: row.state.id)
    count, segments, joints = len(rows), len(model.names), len(skeleton.joint_names)
    keypoints = np.full((count, joints, 3), np.nan)
    keypoint_covariances = np.full((count, joints, 3, 3), np.nan)
    velocities, covariances = np.zeros((count, segments, 6)), np.full((count, segments, 6, 6), np.nan)
    biases = np.square(skeleton.bias_floors or np.zeros(joints))[:, None, None] * np.eye(3)
    for k, row in enumerate(rows):
        state = row.state
        if state.velocities is not None and state.spins is not None:
            velocities[k] = np.concatenate([state.velocities, state.spins], axis=-1)
        if state.covariances is not None:
            covariances[k] = state.covariances
        sites = _sites(row.body, skeleton)
        _carry(*sites, state.places, state.frames, covariances[k], keypoints[k], keypoint_covariances[k])
        keypoint_covariances[k] += biases
        covariances[k, :, :3, :3] += biases.mean(axis=0)
    frames = np.array([row.state.frames for row in rows]).reshape(count, segments, 3, 3)
    places = np.array([row.state.places for row in rows]).reshape(count, segments, 3)
    if calibration is not None:
        keypoint_covariances += calibration.of_people(keypoints, (), None)
        covariances[:, :, :3, :3] += calibration.of_people(places, (), None)
    return BodyStateSet(
        index,
        stamp_ns,
        max(newest_ns, stamp_ns),
        skeleton.hash,
        model.names,
        model.parents,
        np.array([row.state.id for row in rows], np.int64),
        np.array([row.source for row in rows], np.uint8),
        np.array([row.views for row in rows], np.int32),
        np.array([row.devices for row in rows], np.int32),
        np.array([row.body.offsets for row in rows]).reshape(count, segments, 3),
        _freedoms(model, places, frames),
        places,
        to_quaternions(frames.reshape(-1, 3, 3)).reshape(count, segments, 4),
        velocities,
        covariances,
        keypoints,
        keypoint_covariances,
    )


def _freedoms(model: SegmentModel, places: Array, frames: Array) -> Array:
    """Return root positions and rotation vectors (B, 3 + 3 S) of bodies.

    Args:
        places, frames: (B, S, 3) m and (B, S, 3, 3).
    """
    above = frames[:, model.parents]
    turns = above.swapaxes(-1, -2) @ frames
    turns[:, 0] = frames[:, 0]
    vectors = vectors_of(np.ascontiguousarray(turns.reshape(-1, 3, 3)))
    vectors = vectors.reshape(len(places), 3 * len(model.names))
    return np.concatenate([places[:, 0], vectors], axis=-1)


@lru_cache(maxsize=64)
def _sites(body: SegmentedBody, skeleton: SkeletonModel) -> tuple[Array, Array, Array]:
    """Return the skeleton's joints (N,) that a body has, their segments (N,) and offsets (N, 3) m.

    Offsets are in the frames of the segments.
    """
    known = [
        (j, *body.keypoints[name]) for j, name in enumerate(skeleton.joint_names) if name in body.keypoints
    ]
    return (
        np.array([j for j, _, _ in known], np.int64),
        np.array([s for _, s, _ in known], np.int64),
        np.array([place for _, _, place in known], np.float64).reshape(-1, 3),
    )


@njit(cache=True, error_model="numpy", nogil=True)
def _carry(
    joints: Array,
    segments: Array,
    offsets: Array,
    places: Array,
    frames: Array,
    covariances: Array,
    points: Array,
    spreads: Array,
) -> None:
    """Compute joints (J, 3) m and their covariances (J, 3, 3) m^2 from the segments.

    Args:
        joints, segments, offsets: (N,), (N,) and (N, 3) m, see `_sites`.
        places, frames, covariances: (S, 3) m, (S, 3, 3) and (S, 6, 6), of the segments.
        points, spreads: (J, 3) and (J, 3, 3) outputs.
    """
    slope = np.zeros((3, 6))
    for i in range(3):
        slope[i, i] = 1.0
    for n in range(len(joints)):
        s, j = segments[n], joints[n]
        x, y, z = frames[s] @ offsets[n]
        points[j, 0], points[j, 1], points[j, 2] = places[s, 0] + x, places[s, 1] + y, places[s, 2] + z
        slope[0, 4], slope[0, 5] = z, -y  # derivatives of u x arm by u
        slope[1, 3], slope[1, 5] = -z, x
        slope[2, 3], slope[2, 4] = y, -x
        spreads[j] = slope @ covariances[s] @ slope.T
