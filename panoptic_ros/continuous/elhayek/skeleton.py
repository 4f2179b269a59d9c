"""Kinematic skeleton whose joints are hinges in rows, and its degrees of freedom (paper, 4).

Every joint parameter is the rotation about one fixed axis. A matrix maps the degrees of freedom to the joint
parameters, so that four joints of the spine share a bend. Root: position, then yaw, pitch and roll.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from panoptic_ros.domain.segments import SegmentedBody, SegmentModel
from panoptic_ros.errors import UsageError
from panoptic_ros.geometry.rotations import rotations_of

Array = np.ndarray
X, Y, Z = np.eye(3)
FREE = math.inf
SHOULDER_DEG = ((-180.0, 180.0), (-45.0, 115.0), (-110.0, 110.0))  # about pole, elevation, along the bone


class Freedom(NamedTuple):
    """One degree of freedom.

    Args:
        segments: segments that it turns, each by the same share of the angle.
        axis: (3,) unit vector in the frame of the joint before this rotation.
        limits: (rad, rad), or None = those of the segment model about this axis.
        elevates: True if it moves an upper arm away from its pole.
        bends: True for elbows and knees. The previous degree of freedom turns that limb about its upper bone.
    """

    segments: tuple[str, ...]
    axis: Array
    limits: tuple[float, float] | None = None
    elevates: bool = False
    bends: bool = False


class PlacedSkeleton(NamedTuple):
    """HingeSkeleton at T instants.

    Args:
        places: (T, S, 3) m, joints.
        frames: (T, S, 3, 3), world from segment.
        axes: (T, P, 3) axes of the joint parameters in the world.
    """

    places: Array
    frames: Array
    axes: Array

    def points(self, segments: Array, offsets: Array) -> Array:
        """Return the world positions (T, N, 3) m of points on segments (N,) at offsets (N, 3) m."""
        found: Array = self.places[:, segments] + (self.frames[:, segments] @ offsets[:, :, None])[..., 0]
        return found


@dataclass(frozen=True, eq=False)
class HingeSkeleton:
    """HingeSkeleton of one person: D degrees of freedom, P joint parameters, S segments, J detected joints.

    Args:
        parents: (S,), parents first, -1 = root.
        offsets: (S, 3) m, joints in the frames of their parents.
        turned: (P,) segment that each joint parameter turns; those of a segment are in a row.
        axes: (P, 3) unit vectors.
        mapping: (P, D - 3) joint parameters from degrees of freedom (the paper's matrix).
        limits: (D, 2), lower and upper limit of each degree of freedom; infinite = none.
        site_segments: (J,) segments of the detector's joints, -1 = not part of the skeleton.
        site_offsets: (J, 3) m in the frames of these segments.
        above: (S, P) True where a joint parameter moves a segment.
        elevations: degrees of freedom of the shoulders that lift the arms.
        bends: degrees of freedom of elbows and knees. The one before turns the limb about its upper bone.
    """

    parents: Array
    offsets: Array
    turned: Array
    axes: Array
    mapping: Array
    limits: Array
    site_segments: Array
    site_offsets: Array
    above: Array
    elevations: tuple[int, ...]
    bends: tuple[int, ...]

    @property
    def freedoms(self) -> int:
        """Return the number of degrees of freedom."""
        return 3 + int(self.mapping.shape[1])

    @property
    def seen(self) -> Array:
        """Return the detected joints (K,) that are part of the skeleton."""
        found: Array = np.flatnonzero(self.site_segments >= 0)
        return found

    def place(self, freedoms: Array) -> PlacedSkeleton:
        """Return the skeleton for degrees of freedom (T, D)."""
        count = len(freedoms)
        turns = (freedoms[:, 3:] @ self.mapping.T)[..., None] * self.axes
        turned = rotations_of(turns.reshape(-1, 3)).reshape(*turns.shape, 3)
        places = np.empty((count, len(self.parents), 3))
        frames = np.empty((count, len(self.parents), 3, 3))
        axes = np.empty((count, len(self.axes), 3))
        for s, parent in enumerate(self.parents):
            if parent < 0:
                places[:, s], frame = freedoms[:, :3], np.broadcast_to(np.eye(3), (count, 3, 3))
            else:
                frame = frames[:, parent]
                places[:, s] = places[:, parent] + frame @ self.offsets[s]
            for p in np.flatnonzero(self.turned == s):
                axes[:, p] = frame @ self.axes[p]
                frame = frame @ turned[:, p]
            frames[:, s] = frame
        return PlacedSkeleton(places, frames, axes)

    def moved(self, freedoms: Array, segments: Array, offsets: Array) -> tuple[Array, Array]:
        """Return points on segments (N,) at offsets (N, 3) m for degrees of freedom (T, D).

        Returns:
            world positions (T, N, 3) m, and their derivatives (T, N, 3, D) by the degrees of freedom.
        """
        placed = self.place(freedoms)
        points = placed.points(segments, offsets)
        # axis x (point - origin), with the matrix of each axis
        crosses = np.cross(placed.axes[:, :, None], np.eye(3)).swapaxes(1, 2)
        turning = points @ crosses.reshape(len(freedoms), 3, -1)
        turning = turning.reshape(*points.shape[:2], -1, 3)
        turning -= np.cross(placed.axes, placed.places[:, self.turned])[:, None]
        turning *= self.above[segments][:, :, None]
        slopes = np.empty((*points.shape, self.freedoms))
        slopes[..., :3] = np.eye(3)
        slopes[..., 3:] = turning.swapaxes(-1, -2) @ self.mapping
        return points, slopes

    def joints(self, freedoms: Array) -> Array:
        """Return the detector's joints (T, J, 3) m for degrees of freedom (T, D); NaN for those without."""
        found = self.place(freedoms).points(self.site_segments, self.site_offsets)
        found[:, self.site_segments < 0] = np.nan
        return found


def skeleton_of(body: SegmentedBody, joint_names: Iterable[str]) -> HingeSkeleton:
    """Return the skeleton of a body for the joints of a detector.

    A rotation that moves no detected joint is left out: nothing determines it.

    Raises:
        UsageError: if the segment model lacks a segment of `freedoms_of`.
    """
    model, seen = body.model, body.seen
    names = list(joint_names)
    sites = np.array([seen[name][0] if name in seen else -1 for name in names])
    site_offsets = np.array([seen[name][1] if name in seen else np.zeros(3) for name in names])
    needed = _moved(model, sites, site_offsets)
    rows = [row for row in freedoms_of(model) if any(needed[model.index(s)] for s in row.segments)]
    parameters = [(model.index(s), d) for d, row in enumerate(rows) for s in row.segments]
    turned = np.array([s for s, _ in parameters])
    mapping = np.zeros((len(parameters), len(rows)))
    for p, (_, d) in enumerate(parameters):
        mapping[p, d] = 1.0 / len(rows[d].segments)
    above = np.zeros((len(model.names), len(parameters)), bool)
    for s, parent in enumerate(model.parents):
        above[s] = turned == s
        if parent >= 0:
            above[s] |= above[parent]
    limits = [(-FREE, FREE)] * 3 + [row.limits or _model_limits(model, row) for row in rows]
    return HingeSkeleton(
        model.parents,
        body.offsets,
        turned,
        np.array([rows[d].axis for _, d in parameters]),
        mapping,
        np.array(limits),
        sites,
        site_offsets,
        above,
        tuple(3 + d for d, row in enumerate(rows) if row.elevates),
        tuple(3 + d for d, row in enumerate(rows) if row.bends),
    )


def freedoms_of(model: SegmentModel) -> list[Freedom]:
    """Return the rotational degrees of freedom of a person, in the axes of a T posture facing +x.

    Raises:
        UsageError: if the model lacks a segment.
    """
    none = (-FREE, FREE)
    spine = tuple(name for name in model.names if name.startswith("spine"))
    rows = [Freedom(("hips",), axis, none) for axis in (Z, Y, X)]
    rows += [Freedom(spine, axis) for axis in (Z, Y, X)]
    rows += [Freedom(("neck", "head"), axis) for axis in (Z, Y, X)]
    for side, sign in (("l", 1.0), ("r", -1.0)):
        rows += _shoulder(side, sign)
        rows += [Freedom((f"{side}Forearm",), Z, bends=True)]
        rows += [Freedom((f"{side}Thigh",), axis) for axis in (Y, X, Z)]
        rows += [Freedom((f"{side}Shin",), Y, bends=True)]
        rows += [Freedom((f"{side}Foot",), axis) for axis in (Y, Z)]
    missing = sorted({s for row in rows for s in row.segments} - set(model.names))
    if missing or not spine:
        lacks = ", ".join(missing) or "a spine"
        raise UsageError(f"the skeleton of segments lacks {lacks}; use segments21")
    return rows


def _shoulder(side: str, sign: float) -> list[Freedom]:
    """Return the degrees of freedom of a shoulder: about a pole, away from the pole, and about the bone.

    Two angles of a direction have two poles at which the first one is undetermined. The pole points back, out
    and up; neither it nor its opposite, through the trunk, is a usual direction of an upper arm.
    """
    bone = sign * Y
    pole = (-X + bone + Z) / math.sqrt(3.0)
    across = np.cross(pole, bone)
    across /= np.linalg.norm(across)
    segment = (f"{side}UpperArm",)
    limits = [(math.radians(low), math.radians(high)) for low, high in SHOULDER_DEG]
    axes = (pole, across, bone)  # a positive second angle leads away from the pole
    return [Freedom(segment, axis, pair, axis is across) for axis, pair in zip(axes, limits)]


def _moved(model: SegmentModel, sites: Array, site_offsets: Array) -> Array:
    """Return whether a rotation of each segment (S,) moves a detected joint.

    A joint at the origin of a segment belongs to the parent here.
    """
    moved = np.zeros(len(model.names), bool)
    for site, offset in zip(sites, site_offsets):
        s = int(site)
        if s >= 0 and not offset.any():
            s = int(model.parents[s])
        while s >= 0:
            moved[s] = True
            s = int(model.parents[s])
    return moved


def _model_limits(model: SegmentModel, row: Freedom) -> tuple[float, float]:
    """Return the limits of the segment model about an axis of the frame, for all segments of a row."""
    axis = int(np.argmax(np.abs(row.axis)))
    at = [model.index(name) for name in row.segments]
    share = 1.0 / len(at)
    return float(model.lower[at, axis].max() / share), float(model.upper[at, axis].min() / share)
