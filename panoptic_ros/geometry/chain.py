"""Chains of segments: forward kinematics, its derivatives, and small steps of a pose."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.geometry.rotations import rotation_of, vector_of
from panoptic_ros.geometry.segment_chain import Chain
from panoptic_ros.kernels import njit

Array = np.ndarray

_jit = njit(cache=True, error_model="numpy", nogil=True)


class Pose(NamedTuple):
    """Pose of a chain of S segments.

    Args:
        root: (3,) m, position of the root.
        turns: (S, 3, 3) rotation of each segment's frame in its parent's; of the root's in the world.
    """

    root: Array
    turns: Array

    def copy(self) -> Pose:
        """Return a copy with arrays of its own."""
        return Pose(self.root.copy(), self.turns.copy())


@_jit
def multiply(a: Array, b: Array, out: Array) -> None:
    """Write the product of two matrices (3, 3) to `out`, which must be neither of them."""
    for i in range(3):
        for j in range(3):
            out[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]


@_jit
def place_segments(chain: Chain, pose: Pose, frames: Array, places: Array) -> None:
    """Compute the frames and joint positions of all segments, Malleson et al. eq. 1.

    Args:
        frames: (S, 3, 3) output, world from segment.
        places: (S, 3) m, output, positions of the joints.
    """
    places[0] = pose.root
    frames[0] = pose.turns[0]
    for s in range(1, len(chain.parents)):
        parent = chain.parents[s]
        multiply(frames[parent], pose.turns[s], frames[s])
        for j in range(3):
            places[s, j] = places[parent, j] + (
                frames[parent, j, 0] * chain.offsets[s, 0]
                + frames[parent, j, 1] * chain.offsets[s, 1]
                + frames[parent, j, 2] * chain.offsets[s, 2]
            )


@_jit
def step_pose(pose: Pose, step: Array, out: Pose) -> None:
    """Write the pose after a step (3 + 3 S,) to `out`: root + u, and exp(u) R for each rotation.

    For a rotation, u is in the parent's frame.
    """
    turn = np.empty((3, 3))
    for j in range(3):
        out.root[j] = pose.root[j] + step[j]
    for s in range(len(pose.turns)):
        rotation_of(step[3 + 3 * s : 6 + 3 * s], turn)
        multiply(turn, pose.turns[s], out.turns[s])


@_jit
def step_between(begin: Pose, end: Pose, out: Array) -> None:
    """Write the step (3 + 3 S,) that leads from pose `begin` to pose `end` to `out`."""
    turn = np.empty((3, 3))
    for j in range(3):
        out[j] = end.root[j] - begin.root[j]
    for s in range(len(begin.turns)):
        for i in range(3):
            for j in range(3):
                turn[i, j] = (
                    end.turns[s, i, 0] * begin.turns[s, j, 0]
                    + end.turns[s, i, 1] * begin.turns[s, j, 1]
                    + end.turns[s, i, 2] * begin.turns[s, j, 2]
                )
        vector_of(turn, out[3 + 3 * s : 6 + 3 * s])


@_jit
def place_sites(chain: Chain, pose: Pose, segments: Array, offsets: Array, slopes: Array) -> Array:
    """Return the positions (N, 3) m of sites on the segments, and compute their derivatives.

    Args:
        segments: (N,) segment of each site.
        offsets: (N, 3) m, position of each site in its segment's frame.
        slopes: (N, 3, 3 + 3 S) output, derivatives by the degrees of freedom.
    """
    count = len(chain.parents)
    frames, places = np.empty((count, 3, 3)), np.empty((count, 3))
    place_segments(chain, pose, frames, places)
    found = np.empty((len(segments), 3))
    slopes[:] = 0.0
    for n in range(len(segments)):
        s = segments[n]
        for j in range(3):
            found[n, j] = places[s, j] + (
                frames[s, j, 0] * offsets[n, 0]
                + frames[s, j, 1] * offsets[n, 1]
                + frames[s, j, 2] * offsets[n, 2]
            )
            slopes[n, j, j] = 1.0
        while s >= 0:
            parent = chain.parents[s]
            x, y, z = found[n, 0] - places[s, 0], found[n, 1] - places[s, 1], found[n, 2] - places[s, 2]
            for k in range(3):
                if parent < 0:
                    a, b, c = 1.0 * (k == 0), 1.0 * (k == 1), 1.0 * (k == 2)
                else:
                    a, b, c = frames[parent, 0, k], frames[parent, 1, k], frames[parent, 2, k]
                slopes[n, 0, 3 + 3 * s + k] = b * z - c * y
                slopes[n, 1, 3 + 3 * s + k] = c * x - a * z
                slopes[n, 2, 3 + 3 * s + k] = a * y - b * x
            s = parent
    return found


@_jit
def turn_slopes(chain: Chain, pose: Pose, segments: Array, slopes: Array) -> Array:
    """Return the frames (N, 3, 3) of segments (N,), and compute their derivatives.

    Args:
        slopes: (N, 3, 3 + 3 S) output: rotation in the world, rad, by the degrees of freedom.
    """
    count = len(chain.parents)
    frames, places = np.empty((count, 3, 3)), np.empty((count, 3))
    place_segments(chain, pose, frames, places)
    found = np.empty((len(segments), 3, 3))
    slopes[:] = 0.0
    for n in range(len(segments)):
        s = segments[n]
        found[n] = frames[s]
        while s >= 0:
            parent = chain.parents[s]
            for j in range(3):
                for k in range(3):
                    slopes[n, j, 3 + 3 * s + k] = 1.0 * (j == k) if parent < 0 else frames[parent, j, k]
            s = parent
    return found


def place_all(chain: Chain, roots: Array, turns: Array) -> tuple[Array, Array]:
    """Return the positions (T, S, 3) m and frames (T, S, 3, 3) of T poses.

    Args:
        roots: (T, 3) m.
        turns: (T, S, 3, 3), see `Pose`.
    """
    frames, places = np.empty(turns.shape), np.empty(turns.shape[:-1])
    for t in range(len(roots)):
        place_segments(chain, Pose(roots[t], turns[t]), frames[t], places[t])
    return places, frames
