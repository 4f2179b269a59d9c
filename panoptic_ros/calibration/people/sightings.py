"""JointSightings: joints of all tracklets at common instants, from the nearest frame of each camera."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from panoptic_ros.calibration.people.tracklets import Tracklet

Array = np.ndarray
NEAREST = 0.6  # frame periods, largest time between an instant and the frame that stands for it


class JointSightings(NamedTuple):
    """Joints of N tracklets at K instants.

    Args:
        cameras: (N,) camera of each tracklet.
        instants: (K,) s.
        seen: (N, K) whether the tracklet has a frame near the instant.
        late: (N, K) s, time of that frame, on the clock of its camera, minus the instant.
        points: (N, K, J, 2) px of that frame, NaN where a joint is missing.
        scores: (N, K, J). plane_speeds: (N, K, J, 2) s^-1.
        plane: (N, K, J, 2) undistorted normalised points, moved to the instant along their velocity.
    """

    cameras: Array
    instants: Array
    seen: Array
    late: Array
    points: Array
    scores: Array
    plane_speeds: Array
    plane: Array


def sightings_at(tracklets: Sequence[Tracklet], instants: Array, offsets: Array) -> JointSightings:
    """Return the joints of tracklets at instants (K,) s, given the clock offsets (C,) s of the cameras.

    A frame is exposed at its stamp plus the offset of its camera.
    """
    count, joints = len(tracklets), tracklets[0].points.shape[1]
    shape = (count, len(instants))
    seen, late = np.zeros(shape, bool), np.zeros(shape)
    points, speeds = np.full((*shape, joints, 2), np.nan), np.zeros((*shape, joints, 2))
    plane, scores = np.full((*shape, joints, 2), np.nan), np.zeros((*shape, joints))
    for n, own in enumerate(tracklets):
        times = own.stamps + offsets[own.camera]
        period = float(np.median(np.diff(times)))
        after = np.clip(np.searchsorted(times, instants), 1, len(times) - 1)
        nearest = np.where(instants - times[after - 1] < times[after] - instants, after - 1, after)
        good = np.abs(times[nearest] - instants) <= NEAREST * period
        frames = nearest[good]
        seen[n] = good
        late[n, good] = own.stamps[frames] - instants[good]
        points[n, good], scores[n, good] = own.points[frames], own.scores[frames]
        speeds[n, good] = own.plane_speeds[frames]
        plane[n, good] = own.plane[frames]
        plane[n, good] -= own.plane_speeds[frames] * (times[frames] - instants[good])[:, None, None]
    cameras = np.array([own.camera for own in tracklets])
    return JointSightings(cameras, instants, seen, late, points, scores, speeds, plane)
