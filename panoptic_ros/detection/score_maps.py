"""Sparse score maps: a network's maps without their small values, as patches.

Networks that detect all people at once have one map per joint for all of them. Cells near a person's joint
become a patch of that person. A gate that grows with the person's size limits the patch, and each cell goes
to the nearest joint. Blobs that belong to no person keep person -1: voting can find people there whom the
network's person head missed.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from panoptic_ros.detection.patch_kernels import NOBODY, levels_of, patches_of
from panoptic_ros.domain import JointMap, ScoreMaps

Array = np.ndarray
GATE_PER_HEIGHT = 0.15  # radius of the gate; a blob's sigma is about 0.04 of the person's height
GATE_CELLS = (3.0, 14.0)  # least and greatest radius


@dataclass(frozen=True, eq=False)
class MapPatch:
    """Window of one joint's score map; cells that belong to other people are 0."""

    joint: int  # network's joint index
    person: int
    corner: tuple[int, int]  # column, row
    values: Array  # (rows, columns) uint8


@dataclass(frozen=True, eq=False)
class PatchArrays:
    """N patches in two arrays.

    Args:
        rows: (N, 7) joint, person, left, top, width, height, index of the first value in `data`.
        data: (D,) uint8 values, one window after the other.
    """

    rows: Array
    data: Array

    @classmethod
    def of(cls, patches: Sequence[MapPatch]) -> PatchArrays:
        """Combine single patches."""
        begins = np.cumsum([0] + [patch.values.size for patch in patches])
        rows = [
            (patch.joint, patch.person, *patch.corner, *patch.values.shape[::-1], begin)
            for patch, begin in zip(patches, begins.tolist())
        ]
        data = [np.zeros(0, np.uint8)] + [patch.values.ravel() for patch in patches]
        return cls(np.array(rows, np.int64).reshape(-1, 7), np.concatenate(data))

    def __len__(self) -> int:
        return len(self.rows)

    def __iter__(self) -> Iterator[MapPatch]:
        for joint, person, left, top, width, height, begin in self.rows.tolist():
            values = self.data[begin : begin + width * height].reshape(height, width)
            yield MapPatch(joint, person, (left, top), values)

    def chosen(self, index: Array) -> PatchArrays:
        """Return the patches at the indices (M,), in this order."""
        if np.array_equal(index, np.arange(len(self))):
            return self
        kept = list(self)
        return PatchArrays.of([kept[i] for i in index])


@dataclass(frozen=True, eq=False)
class PatchSet:
    """All patches of one image on one grid."""

    grid_size: tuple[int, int]  # width, height
    grid_from_image: Array  # (2, 3)
    patches: PatchArrays

    def score_maps(self, joint_map: JointMap) -> ScoreMaps:
        """Return the record in the joints of the working skeleton; joints that are means have no maps."""
        joints = self.patches.rows[:, 0]
        targets, counts, begins = _targets(joint_map)
        times = counts[joints]
        index = np.repeat(np.arange(len(joints)), times)
        which = np.arange(len(index)) - np.repeat(np.cumsum(times) - times, times)
        own = targets[begins[joints[index]] + which]
        patches = self.patches.chosen(index)
        rows = patches.rows.astype(np.int32)
        return ScoreMaps(
            grid_size=self.grid_size,
            grid_from_image=self.grid_from_image,
            joints=own.astype(np.int32),
            persons=rows[:, 1],
            corners=rows[:, 2:4],
            sizes=rows[:, 4:6],
            data=patches.data,
        )

    def unclaimed_joints(self, least: float) -> int:
        """Return the number of joints with a peak of at least `least` that belongs to no person."""
        level, rows = least * 255.0, self.patches.rows
        if not len(rows):
            return 0
        peaks = np.maximum.reduceat(self.patches.data, rows[:, 6])
        return len(set(rows[(rows[:, 1] == NOBODY) & (peaks >= level), 0].tolist()))


@lru_cache(maxsize=64)
def _targets(joint_map: JointMap) -> tuple[Array, Array, Array]:
    """Return the working joints that copy one network joint, grouped by network joint.

    Returns:
        the working joints, their number (K,) for each network joint, and the index (K,) of the first of each
            group.
    """
    lists: list[list[int]] = [[] for _ in range(joint_map.source_count)]
    for working, sources in enumerate(joint_map.sources):
        if len(sources) == 1:
            lists[sources[0]].append(working)
    counts = np.array([len(own) for own in lists], np.int64)
    targets = np.array([joint for own in lists for joint in own], np.int64)
    return targets, counts, np.cumsum(counts) - counts


def quantised(maps: Array, cut: float) -> Array:
    """Quantise maps in 0..1 to uint8 in 0..255; values below `cut` become 0."""
    levels: Array = levels_of(np.ascontiguousarray(maps, np.float32), np.float32(cut))
    return levels


def gate_radius(heights: Array) -> Array:
    """Return the gate radius of each person in cells, from the height (P,) in cells."""
    return np.clip(GATE_PER_HEIGHT * heights, *GATE_CELLS)


def merged_patches(levels: Array, cells: Array, seen: Array, radius: Array) -> PatchArrays:
    """Cut maps (K, h, w) uint8 that all people share into patches.

    Args:
        cells: (P, K, 2) column and row of the people's joints.
        seen: (P, K) which joints count.
        radius: (P,) gate radius in cells.
    """
    places = np.array(cells, np.float64).reshape(len(radius), len(levels), 2)
    return PatchArrays(
        *patches_of(np.ascontiguousarray(levels), places, np.array(seen, bool), np.array(radius, np.float64))
    )


def person_patches(levels: Array, person: int, corner: tuple[int, int] = (0, 0)) -> list[MapPatch]:
    """Cut maps (K, h, w) uint8 of one person alone into patches; they start at column and row `corner`."""
    patches: list[MapPatch] = []
    for joint, values in enumerate(levels):
        patches += _trimmed(joint, person, corner, values)
    return patches


def gated(levels: Array, cells: Array, seen: Array, radius: float) -> Array:
    """Return maps (K, h, w) with 0 outside the gates round one person's joints (K, 2)."""
    owners = _owners(levels, cells[None], seen[None], np.array([radius]))
    return np.where(owners == NOBODY, 0, levels)


def _owners(levels: Array, cells: Array, seen: Array, radius: Array) -> Array:
    """Return the person (K, h, w) that each cell belongs to; `NOBODY` for cells without one."""
    owners = np.full(levels.shape, NOBODY, np.int16)
    nearest = np.full(levels.shape, np.inf, np.float32)
    for person, joint in zip(*np.nonzero(seen)):
        x, y = cells[person, joint]
        left, top, right, bottom = _window(x, y, radius[person], levels.shape)
        across = (np.arange(left, right) - x) ** 2
        down = (np.arange(top, bottom) - y) ** 2
        distance = (down[:, None] + across[None, :]).astype(np.float32)
        window = nearest[joint, top:bottom, left:right]
        mine = (distance <= radius[person] ** 2) & (distance < window)
        window[mine] = distance[mine]
        owners[joint, top:bottom, left:right][mine] = person
    return owners


def _window(x: float, y: float, radius: float, shape: tuple[int, ...]) -> tuple[int, int, int, int]:
    """Return left, top, right, bottom of the cells within `radius` of a place, clipped to the map."""
    _, rows, columns = shape
    left, right = max(math.ceil(x - radius), 0), min(math.floor(x + radius) + 1, columns)
    top, bottom = max(math.ceil(y - radius), 0), min(math.floor(y + radius) + 1, rows)
    return min(left, columns), min(top, rows), max(right, 0), max(bottom, 0)


def _trimmed(joint: int, person: int, corner: tuple[int, int], values: Array) -> list[MapPatch]:
    """Return the patch without its empty margins, or no patch if all values are 0."""
    left, top, width, height = cv2.boundingRect(values) if values.size else (0, 0, 0, 0)
    if not width:
        return []
    inner = values[top : top + height, left : left + width]
    return [MapPatch(joint, person, (corner[0] + left, corner[1] + top), inner)]


def warm_up() -> None:
    """Compile the kernels for patches."""
    quantised(np.zeros((1, 2, 2), np.float32), 0.1)
    merged_patches(np.zeros((1, 2, 2), np.uint8), np.zeros((1, 1, 2)), np.ones((1, 1), bool), np.ones(1))
