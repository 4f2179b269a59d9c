"""Which points on the people of an image are followed: a fixed pattern on every rigid part.

Patterns, not corners: a part needs points all over it to tell its rotation, and every point says itself, by
the texture round it, in which direction it can be followed (`tracking`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.domain import SkeletonModel
from panoptic_ros.domain.parts import Part, rigid_parts

Array = np.ndarray
ALONG, ACROSS = (0.08, 0.36, 0.64, 0.92), (-0.5, 0.5)  # of the length and of the radius of a limb
TORSO_ALONG, TORSO_ACROSS = (0.0, 0.25, 0.5, 0.75, 1.0), (-0.75, -0.25, 0.25, 0.75)
TORSO_LENGTH = 0.5  # m, from the middle of the shoulders to that of the hips
TORSO_WIDTH = 0.1  # m, least half width that is looked at
HEAD_RING = 0.055  # m
QUANTILE = 0.8  # of the scales that parts say: parts that point at the camera look small
FEWEST = 3  # joints of a person who is followed


class Laid(NamedTuple):
    """N points on P people: points (N, 2) px, person (N,) and part (N,) of each, ordered by person.

    middles (P, 2) px and scales (P,) px per metre of the people; NaN = nothing is laid on that one.
    """

    points: Array
    persons: Array
    parts: Array
    middles: Array
    scales: Array


class Pattern:
    """Lays points on 2D people of a skeleton."""

    def __init__(self, skeleton: SkeletonModel):
        self.parts = rigid_parts(skeleton)
        names = [name.lower() for name in skeleton.joint_names]
        self._shoulders, self._hips = (
            [j for j, name in enumerate(names) if word in name] for word in ("shoulder", "hip")
        )
        self._has_torso = len(self._shoulders) == 2 and len(self._hips) == 2
        angles = np.arange(6) * np.pi / 3
        ring = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        self._ring = HEAD_RING * np.concatenate([np.zeros((1, 2)), ring])

    def lay(self, points: Array, there: Array) -> Laid:
        """Points on people with joints (P, J, 2) px that are there (P, J)."""
        laid, persons, parts = [np.zeros((0, 2))], [], []
        middles, scales = np.full((len(points), 2), np.nan), np.full(len(points), np.nan)
        for person in np.flatnonzero(there.sum(axis=1) >= FEWEST).tolist():
            own = np.where(there[person, :, None], points[person], np.nan)
            scale = self._scale(own)
            if not np.isfinite(scale):
                continue
            middles[person], scales[person] = np.nanmean(own, axis=0), scale
            for number, part in enumerate(self.parts):
                found = self._on(part, own, scale)
                laid.append(found)
                persons += [person] * len(found)
                parts += [number] * len(found)
        return Laid(
            np.concatenate(laid), np.array(persons, np.int32), np.array(parts, np.int32), middles, scales
        )

    def _scale(self, points: Array) -> float:
        """Px per metre of a person with joints (J, 2), NaN = not there; NaN if no part tells."""
        lengths = [
            np.linalg.norm(points[part.joints[1]] - points[part.joints[0]]) / part.length
            for part in self.parts
            if part.is_limb
        ]
        if self._has_torso:
            axis = points[self._shoulders].mean(axis=0) - points[self._hips].mean(axis=0)
            lengths.append(np.linalg.norm(axis) / TORSO_LENGTH)
        known = [length for length in lengths if np.isfinite(length)]
        return float(np.quantile(known, QUANTILE)) if known else np.nan

    def _on(self, part: Part, points: Array, scale: float) -> Array:
        """Points (N, 2) on a part of a person."""
        if part.name == "head":
            middle = points[list(part.joints)]
            middle = middle[np.isfinite(middle[:, 0])]
            return middle.mean(axis=0) + scale * self._ring if len(middle) else np.zeros((0, 2))
        if part.name == "torso":
            if not self._has_torso:
                return np.zeros((0, 2))
            left, right = self._shoulders[0], self._shoulders[1]
            shoulders, hips = points[self._shoulders].mean(axis=0), points[self._hips].mean(axis=0)
            half = max(0.5 * float(np.linalg.norm(points[left] - points[right])), TORSO_WIDTH * scale)
            return _grid(shoulders, hips, half, TORSO_ALONG, TORSO_ACROSS)
        first, last = points[part.joints[0]], points[part.joints[1]]
        return _grid(first, last, part.radius * scale, ALONG, ACROSS)


def _grid(
    first: Array, last: Array, half: float, along: tuple[float, ...], across: tuple[float, ...]
) -> Array:
    """Points (N, 2) px between two ends (2,) px, aside by shares of `half` px; none if an end is NaN."""
    axis = last - first
    length = float(np.linalg.norm(axis))
    if not length > 0.0:
        return np.zeros((0, 2))
    side = half / length * np.array([-axis[1], axis[0]])
    steps = first + np.array(along)[:, None] * axis
    grid: Array = (steps[:, None] + np.array(across)[None, :, None] * side).reshape(-1, 2)
    return grid
