"""Compiled non-maximum suppression of scattered voxels. Calls nothing outside of this file."""
from __future__ import annotations

import numpy as np

from panoptic_ros.kernels import njit

HASH = -7046029254386353131  # odd, with well mixed bits
BITS = 19  # of a voxel's index per axis, from its least; the rest of 64 for joints

_jit = njit(cache=True, error_model="numpy", nogil=True)


@_jit
def highest(joints, voxels, votes, likely):
    """Which of N voxels of joints (N,) none of the 26 neighbours among them beats (N,).

    Of equally many votes the neighbour that comes first, in the order of x, y, z, beats.

    Args:
        voxels: (N, 3), each 0 < index < 2^19 - 1.
        likely: (N,) 0 where a neighbour is known to beat.
    """
    size = 16
    while size < 4 * len(votes):
        size *= 2
    slots = np.full(size, -1, np.int64)
    keys = np.zeros(len(votes), np.int64)
    for n in range(len(votes)):
        keys[n] = (((joints[n] << BITS | voxels[n, 0]) << BITS | voxels[n, 1]) << BITS) | voxels[n, 2]
        slots[_slot(keys[n], keys, slots)] = n
    steps, count = np.zeros(26, np.int64), 0  # those along few axes first: one of them mostly beats
    for axes in range(1, 4):
        for step in range(27):
            if (step // 9 != 1) + (step // 3 % 3 != 1) + (step % 3 != 1) == axes:
                steps[count] = step
                count += 1
    top = np.ones(len(votes), np.bool_)
    for n in range(len(votes)):
        for step in steps[: 26 if likely[n] else 0]:
            move = ((step // 9 - 1) * (1 << BITS) + step // 3 % 3 - 1) * (1 << BITS) + step % 3 - 1
            other = slots[_slot(keys[n] + move, keys, slots)]
            if other >= 0 and (votes[other] > votes[n] or (votes[other] == votes[n] and move < 0)):
                top[n] = False
                break
        top[n] &= likely[n] > 0
    return top


@_jit
def _slot(key, keys, slots):
    """Where the index of a key is in the hash table, or would be put."""
    mask = len(slots) - 1
    slot = ((key * HASH) >> 24) & mask
    while slots[slot] >= 0 and keys[slots[slot]] != key:
        slot = (slot + 1) & mask
    return slot
