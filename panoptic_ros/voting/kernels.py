"""Compiled kernels of votes (eq. 1 of Joo et al. 2017) at points, and of the way to their local maxima."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.kernels import inlined, njit
from panoptic_ros.voting.lanes import LANES, SIZE, SUPPORT, VOTE, place, vote

Array = np.ndarray
KEY_BITS = 21  # of a voxel's index per axis
KEY_HALF = 1 << (KEY_BITS - 1)
HASH = -7046029254386353131  # odd, with well mixed bits

_jit = njit(cache=True, error_model="numpy", nogil=True)


@_jit
def vote_points(scene, joints, points, view_threshold):
    """Votes (N,) and supporting views (N,) of points (N, 3) m for the joints (N,); scene: `VoteScene`."""
    votes, support = np.zeros(len(points)), np.zeros(len(points), np.int64)
    lanes, mine = np.zeros(SIZE), np.zeros(LANES, np.int64)
    for first in range(0, len(points), LANES):
        count = min(LANES, len(points) - first)
        for c in range(LANES):
            n = first + min(c, count - 1)
            mine[c] = joints[n]
            place(lanes, c, points[n, 0], points[n, 1], points[n, 2])
        vote(scene, mine, view_threshold, lanes)
        for c in range(count):
            votes[first + c], support[first + c] = lanes[VOTE + c], int(lanes[SUPPORT + c])
    return votes, support


class VoteMemory(NamedTuple):
    """A hash table of the ranks of voxels: arrays of one size, a power of two.

    An entry counts if its epoch is the present one.
    """

    keys: Array
    epochs: Array
    ranks: Array


class _Scratch(NamedTuple):
    """The joint of the lanes (8,); the lanes; slots of voxels that wait for votes, of neighbours (27,)."""

    joints: Array
    lanes: Array
    waiting: Array
    near: Array


@_jit
def climb(scene, joints, voxels, volume, wanted, memory):
    """Steepest ascent from voxels (S, 3) for joints (S,), in order of joint, to local maxima (S, 3).

    What it climbs is the vote at the voxel's centre, plus 2 if `wanted.enough` views support it; also
    returned (S,). That is 0 where there is nothing to climb, and for voxels that an earlier ascent has looked
    at: it went higher. Stays within the volume. Entries of the memory are of epoch 0.
    """
    tops, heights = voxels.copy(), np.zeros(len(voxels))
    scratch = _Scratch(
        np.zeros(LANES, np.int64), np.zeros(SIZE), np.zeros(LANES, np.int64), np.zeros(27, np.int64)
    )
    keys, epochs, ranks = memory
    near = scratch.near
    epoch, remembered = 0, 0
    for s in range(len(voxels)):
        if s == 0 or joints[s] != joints[s - 1] or remembered > len(keys) // 2:
            epoch, remembered = epoch + 1, 0
            scratch.joints[:] = joints[s]
        key, start, best = _key(tops[s, 0], tops[s, 1], tops[s, 2]), -1, -1.0
        if epochs[_slot(key, epoch, memory)] == epoch:
            continue
        while key != start and best != 0.0:
            start = key
            count, fresh = _look_about(scene, key, volume, wanted, memory, epoch, scratch)
            remembered += fresh
            for n in range(count):
                slot = near[n]
                rank = ranks[slot]
                if rank > best or (rank == best and rank > 0.0 and keys[slot] < key):
                    best, key = rank, keys[slot]
        tops[s, 0], tops[s, 1], tops[s, 2] = _voxel(key)
        heights[s] = max(best, 0.0)
    return tops, heights


@inlined
def _look_about(scene, key, volume, wanted, memory, epoch, scratch):
    """Remember the ranks of a voxel and its neighbours; how many these are, and how many were not known.

    Writes their slots, in order of voxel.
    """
    i, j, k = _voxel(key)
    x1, y1, z1 = volume.upper
    x0, y0, z0 = volume.lower
    count, waiting, fresh = 0, 0, 0
    for step in range(27):
        a, b, c = i + step // 9 - 1, j + step // 3 % 3 - 1, k + step % 3 - 1
        if x0 <= a < x1 and y0 <= b < y1 and z0 <= c < z1:
            other = _key(a, b, c)
            slot = _slot(other, epoch, memory)
            scratch.near[count] = slot
            count += 1
            if memory.epochs[slot] != epoch:
                memory.keys[slot], memory.epochs[slot], scratch.waiting[waiting] = other, epoch, slot
                side = volume.side
                place(scratch.lanes, waiting, (a + 0.5) * side, (b + 0.5) * side, (c + 0.5) * side)
                waiting += 1
        if waiting == LANES or (waiting and step == 26):
            vote(scene, scratch.joints, wanted.view_threshold, scratch.lanes)
            for n in range(waiting):
                supported = scratch.lanes[SUPPORT + n] >= wanted.enough
                memory.ranks[scratch.waiting[n]] = scratch.lanes[VOTE + n] + (2.0 if supported else 0.0)
            fresh, waiting = fresh + waiting, 0
    return count, fresh


@inlined
def _key(i, j, k):
    """One number per voxel; smaller ones come first among equal votes."""
    return ((i + KEY_HALF) << (2 * KEY_BITS)) | ((j + KEY_HALF) << KEY_BITS) | (k + KEY_HALF)


@inlined
def _voxel(key):
    """The voxel of a key."""
    mask = (1 << KEY_BITS) - 1
    return (key >> (2 * KEY_BITS)) - KEY_HALF, (key >> KEY_BITS & mask) - KEY_HALF, (key & mask) - KEY_HALF


@inlined
def _slot(key, epoch, memory):
    """Where a key is in the hash table, or would be put."""
    mask = len(memory.keys) - 1
    slot = ((key * HASH) >> 24) & mask
    while memory.epochs[slot] == epoch and memory.keys[slot] != key:
        slot = (slot + 1) & mask
    return slot
