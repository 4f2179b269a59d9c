"""Sparse score maps: what is left of a network's maps after cutting small values, as patches.

Networks that find all people at once have one map per joint for everybody. Cells near a person's
joint become that person's patch: within a gate that grows with the person's size, each cell goes
to the nearest joint. Blobs that belong to nobody are kept with person -1: the maps outlive the
list of people, and voting can find there whom the network's person head missed.
"""
from __future__ import annotations

import math
from dataclasses import dataclass, field

import cv2
import numpy as np

from panoptic_ros.detection.patch_kernels import NOBODY, claimed
from panoptic_ros.domain import JointMap, ScoreMaps

Array = np.ndarray
GATE_PER_HEIGHT = 0.15  # radius of the gate; a blob's sigma is about 0.04 of the person's height
GATE_CELLS = (3.0, 14.0)  # at least, at most


@dataclass(frozen=True, eq=False)
class Patch:
    """A window of one joint's map, all cells that are not its owner's being 0."""

    joint: int  # of the network
    person: int
    corner: tuple[int, int]  # column, row
    values: Array  # (rows, columns) uint8


@dataclass(frozen=True, eq=False)
class PatchSet:
    """All patches of one image on one grid."""

    grid_size: tuple[int, int]  # width, height
    grid_from_image: Array  # (2, 3)
    patches: list[Patch] = field(default_factory=list)

    def score_maps(self, joint_map: JointMap) -> ScoreMaps:
        """The record, in the joints of the working skeleton; joints that are means have no maps."""
        targets: dict[int, list[int]] = {}
        for working, sources in enumerate(joint_map.sources):
            if len(sources) == 1:
                targets.setdefault(sources[0], []).append(working)
        rows = [(working, patch) for patch in self.patches for working in targets.get(patch.joint, ())]
        return ScoreMaps(
            grid_size=self.grid_size,
            grid_from_image=self.grid_from_image,
            joints=np.array([working for working, _ in rows], np.int32),
            persons=np.array([patch.person for _, patch in rows], np.int32),
            corners=np.array([patch.corner for _, patch in rows], np.int32).reshape(-1, 2),
            sizes=np.array([patch.values.shape[::-1] for _, patch in rows], np.int32).reshape(-1, 2),
            data=np.concatenate([patch.values.ravel() for _, patch in rows] or [np.zeros(0, np.uint8)]),
        )

    def unclaimed_joints(self, least: float) -> int:
        """How many different joints have a peak of at least `least` that belongs to nobody."""
        level = least * 255.0
        return len({p.joint for p in self.patches if p.person == NOBODY and p.values.max() >= level})


def quantised(maps: Array, cut: float) -> Array:
    """Maps in 0..1 as uint8, 0 below `cut`."""
    levels: Array = np.rint(np.clip(maps, 0.0, 1.0) * 255.0).astype(np.uint8)
    levels[maps < cut] = 0
    return levels


def gate_radius(heights: Array) -> Array:
    """Radius of each person's gates in cells, from his height (P,) in cells."""
    return np.clip(GATE_PER_HEIGHT * heights, *GATE_CELLS)


def merged_patches(levels: Array, cells: Array, seen: Array, radius: Array) -> list[Patch]:
    """Patches of maps (K, h, w) uint8 that all people share.

    Args:
        cells: (P, K, 2) column and row of the people's joints; seen: (P, K) whether they count.
        radius: (P,) cells.
    """
    rest = levels.copy()
    rows, data = claimed(
        rest, np.array(cells, np.float64).reshape(len(radius), len(levels), 2), np.array(seen, bool),
        np.array(radius, np.float64),
    )  # fmt: skip
    own = [
        Patch(joint, person, (left, top), data[begin : begin + width * height].reshape(height, width))
        for joint, person, left, top, width, height, begin in rows.tolist()
    ]
    return own + _blobs(rest)


def person_patches(levels: Array, person: int, corner: tuple[int, int] = (0, 0)) -> list[Patch]:
    """Patches of maps (K, h, w) uint8 of one person alone that start at a column and row."""
    patches: list[Patch] = []
    for joint, values in enumerate(levels):
        patches += _trimmed(joint, person, corner, values)
    return patches


def gated(levels: Array, cells: Array, seen: Array, radius: float) -> Array:
    """Maps (K, h, w) with 0 outside of the gates round one person's joints (K, 2)."""
    owners = _owners(levels, cells[None], seen[None], np.array([radius]))
    return np.where(owners == NOBODY, 0, levels)


def _owners(levels: Array, cells: Array, seen: Array, radius: Array) -> Array:
    """The person (K, h, w) that each cell belongs to, or NOBODY."""
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
    """Left, top, right, bottom of the cells within `radius` of a place, inside the map."""
    _, rows, columns = shape
    left, right = max(math.ceil(x - radius), 0), min(math.floor(x + radius) + 1, columns)
    top, bottom = max(math.ceil(y - radius), 0), min(math.floor(y + radius) + 1, rows)
    return min(left, columns), min(top, rows), max(right, 0), max(bottom, 0)


def _trimmed(joint: int, person: int, corner: tuple[int, int], values: Array) -> list[Patch]:
    """The patch without its empty margins; none if nothing is in it."""
    left, top, width, height = cv2.boundingRect(values) if values.size else (0, 0, 0, 0)
    if not width:
        return []
    inner = values[top : top + height, left : left + width]
    return [Patch(joint, person, (corner[0] + left, corner[1] + top), inner)]


def _blobs(levels: Array) -> list[Patch]:
    """One patch for each connected blob of each map (K, h, w)."""
    count, rows, columns = levels.shape
    # All maps in one tall picture, an empty row between them, so that one call finds all blobs. Most pairs of
    # its rows are empty: they are left out, but for one behind each blob.
    height = count * (rows + 1)
    tall = np.zeros((height + height % 2, columns), np.uint8)
    tall[:height].reshape(count, rows + 1, columns)[:, :rows] = levels
    pairs = tall.reshape(-1, 2 * columns)
    shown: Array = np.asarray(pairs.any(axis=1))
    shown[1:] |= shown[:-1]
    kept = np.flatnonzero(shown)
    short = pairs[kept].reshape(-1, columns)
    if not len(kept):
        return []
    number, labels, boxes, _ = cv2.connectedComponentsWithStats((short > 0).view(np.uint8), connectivity=8)
    patches = []
    for label, (left, top, width, extent, _) in enumerate(boxes[1:number].tolist(), start=1):
        part = np.s_[top : top + extent, left : left + width]
        values = np.where(labels[part] == label, short[part], 0)
        joint, row = divmod(2 * int(kept[top // 2]) + top % 2, rows + 1)
        patches.append(Patch(joint, NOBODY, (left, row), values))
    return patches


def warm_up() -> None:
    """Compile what patches need."""
    merged_patches(np.zeros((1, 2, 2), np.uint8), np.zeros((1, 1, 2)), np.ones((1, 1), bool), np.ones(1))
