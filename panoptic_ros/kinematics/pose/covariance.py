"""Covariances of the position and orientation of each segment, from the covariance of a pose."""

from __future__ import annotations

import numpy as np

from panoptic_ros.geometry.chain import Pose, place_segments
from panoptic_ros.geometry.segment_chain import Chain
from panoptic_ros.kernels import njit

Array = np.ndarray
RIDGE = 1e-9  # regularisation of unobserved degrees of freedom, as in `solve`


def segment_covariances(chain: Chain, pose: Pose, covariance: Array) -> Array:
    """Return the covariances (S, 6, 6) of segment positions (m) and small rotations (rad).

    Both are in the world frame. The matrix of the small rotation is multiplied from the left.

    Args:
        covariance: (3 + 3 S, 3 + 3 S) of the pose increment, upper triangle. The lower triangle is filled in
            place.
    """
    found = np.empty((len(chain.parents), 6, 6))
    _carry(chain, pose, covariance, found)
    return found


@njit(cache=True, error_model="numpy", nogil=True)
def _carry(chain: Chain, pose: Pose, covariance: Array, found: Array) -> None:
    """Propagate the covariance of the pose to all segments, from the root outwards.

    A segment moves with its parent and rotates about its own proximal joint.

    Args:
        covariance: (D, D), upper triangle. The lower triangle is filled in place.
        found: (S, 6, 6) output, see `segment_covariances`.
    """
    count, size = len(chain.parents), len(covariance)
    for i in range(size):
        for j in range(i):
            covariance[i, j] = covariance[j, i]
    frames, places = np.empty((count, 3, 3)), np.empty((count, 3))
    place_segments(chain, pose, frames, places)
    # covariance of each segment's position and rotation with all degrees of freedom
    cross = np.empty((count, 6, size))
    cross[0] = covariance[:6]
    for s in range(1, count):
        parent = chain.parents[s]
        above, own = cross[parent], cross[s]
        x, y, z = places[s] - places[parent]
        for n in range(size):
            own[0, n] = above[0, n] + above[4, n] * z - above[5, n] * y
            own[1, n] = above[1, n] + above[5, n] * x - above[3, n] * z
            own[2, n] = above[2, n] + above[3, n] * y - above[4, n] * x
            for i in range(3):
                total = above[3 + i, n]
                for k in range(3):
                    total += frames[parent, i, k] * covariance[3 + 3 * s + k, n]
                own[3 + i, n] = total
    for s in range(count):
        _close(chain, frames, places, cross[s], s, found[s])


@njit(cache=True, error_model="numpy", nogil=True)
def _close(chain: Chain, frames: Array, places: Array, cross: Array, segment: int, out: Array) -> None:
    """Compute the covariance (6, 6) of a segment from its cross-covariance (6, D) with the pose.

    It is a sum over the joints from the segment to the root.
    """
    out[:] = 0.0
    out[:, :3] = cross[:, :3]
    s = segment
    while s >= 0:
        parent = chain.parents[s]
        p, q, r = places[segment] - places[s]
        for k in range(3):
            if parent < 0:
                x, y, z = 1.0 * (k == 0), 1.0 * (k == 1), 1.0 * (k == 2)
            else:
                x, y, z = frames[parent, 0, k], frames[parent, 1, k], frames[parent, 2, k]
            a, b, c = y * r - z * q, z * p - x * r, x * q - y * p
            for i in range(6):
                value = cross[i, 3 + 3 * s + k]
                out[i, 0] += value * a
                out[i, 1] += value * b
                out[i, 2] += value * c
                out[i, 3] += value * x
                out[i, 4] += value * y
                out[i, 5] += value * z
        s = parent
