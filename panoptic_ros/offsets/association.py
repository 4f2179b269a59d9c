"""Associate the 2D joints of every frame with the joints of tracked persons."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from panoptic_ros.domain import SkeletonModel
from panoptic_ros.domain.rig_arrays import RigArrays
from panoptic_ros.offsets.tracks import TrackInterpolation
from panoptic_ros.solving import scene
from panoptic_ros.solving.agreement import agreement_with_people
from panoptic_ros.solving.frames import CameraFrame

Array = np.ndarray
LEAST_AGREEMENT = 0.25  # minimum mean agreement over the joints of a 2D pose with a track
MIRROR_MARGIN = 1.15  # minimum ratio of the agreement with exchanged sides to that without, to exchange them
LEAST_COMMON = 4  # minimum number of joints that a 2D pose and a track have in common
GATE = 3.0  # maximum distance of a joint from its track, in units of `scale`


@dataclass(frozen=True, slots=True, eq=False)
class JointObservations:
    """N observed 2D joints with their rays.

    Args:
        track: (N,) row of `TrackInterpolation.ids`.
        joint, camera: (N,) indices.
        stamp: (N,) s from the reference, on the camera's own clock, exposure of the row of the joint.
        scores: (N,) detection scores.
        rows, rights: (N, 2, 3) and (N, 2). The ray is rows @ X = rights, in m at the depth of the joint.
        depth: (N,) m, approximate depth in the camera.
    """

    track: Array
    joint: Array
    camera: Array
    stamp: Array
    scores: Array
    rows: Array
    rights: Array
    depth: Array


def associate(
    frames: Sequence[CameraFrame],
    times: Array,
    stamps: Array,
    tracks: TrackInterpolation,
    arrays: RigArrays,
    skeleton: SkeletonModel,
    scale: float,
) -> JointObservations:
    """Associate the 2D poses of every frame with the tracks one to one, in order of decreasing agreement.

    Args:
        times: (F,) s from the reference, frame times corrected by the current clocks.
        stamps: (F,) s, uncorrected frame times.
        scale: (m) distance scale of the agreement: large while the clock errors are large.
    """
    mirror = np.array(skeleton.mirror)
    parts: list[tuple[Array, ...]] = []
    for frame, time, stamp in zip(frames, times, stamps):
        rows, places = tracks.at(float(time + arrays.middles[frame.camera]))
        if len(rows) and len(frame.plane):
            for row, person, mirrored in _pairs(frame, places, arrays, mirror, scale):
                part = _joints(frame, places[row], person, mirror if mirrored else None, arrays, scale)
                parts.append((np.full(len(part[0]), rows[row]), *part[:-1], stamp + part[-1]))
    if not parts:
        empty = np.empty(0)
        none = np.empty(0, np.int64)
        return JointObservations(none, none, none, empty, empty, np.empty((0, 2, 3)), np.empty((0, 2)), empty)
    track, joint, camera, plane, scores, depth, stamp = (np.concatenate(c) for c in zip(*parts))
    rotations, translations = arrays.rotations[camera], arrays.translations[camera]
    sight = plane[..., None] * rotations[:, None, 2] - rotations[:, :2]
    rights = translations[:, :2] - plane * translations[:, 2:]
    return JointObservations(track, joint, camera, stamp, scores, sight, rights, depth)


def _pairs(
    frame: CameraFrame, places: Array, arrays: RigArrays, mirror: Array, scale: float
) -> list[tuple[int, int, bool]]:
    """Return the associations of one frame: (track, 2D pose, sides exchanged)."""
    c = frame.camera
    people = len(frame.plane)
    cams = scene.CameraPoses(arrays.rotations[c : c + 1], arrays.translations[c : c + 1], np.zeros(1))
    seen = scene.SceneObservations(
        frame.plane,
        (frame.scores > 0.0).astype(np.float64),
        np.zeros(people, np.int64),
        np.array([0, people]),
        cams,
        arrays.lenses[c : c + 1],
        np.full(people, np.inf),
        np.zeros(frame.scores.shape),
    )
    straight, mirrored, common = agreement_with_people(places, np.zeros_like(places), seen, mirror, scale)
    flipped = mirrored > MIRROR_MARGIN * straight
    value = np.where(common >= LEAST_COMMON, np.where(flipped, mirrored, straight), 0.0)
    found = []
    while value.size and value.max() >= LEAST_AGREEMENT:
        p, d = np.unravel_index(int(value.argmax()), value.shape)
        found.append((int(p), int(d), bool(flipped[p, d])))
        value[p], value[:, d] = 0.0, 0.0
    return found


def _joints(
    frame: CameraFrame, place: Array, person: int, exchange: Array | None, arrays: RigArrays, scale: float
) -> tuple[Array, ...]:
    """Return the joints inside the gate about the track.

    Returns:
        joint, camera, point, score and depth, and the delay (s) of the image row after the timestamp.
    """
    c = frame.camera
    plane, scores, delays = frame.plane[person], frame.scores[person], frame.heights[person]
    delays = arrays.line_delays[c] * delays
    if exchange is not None:
        plane, scores, delays = plane[exchange], scores[exchange], delays[exchange]
    local = place @ arrays.rotations[c].T + arrays.translations[c]
    depth = local[:, 2]
    front = depth > scene.MIN_DEPTH
    miss = local[:, :2] - plane * depth[:, None]
    near = (scores > 0.0) & front & (np.hypot(miss[:, 0], miss[:, 1]) < GATE * scale)
    joints = np.flatnonzero(near)
    return joints, np.full(len(joints), c), plane[near], scores[near], depth[near], delays[near]
