"""Segment skeleton as data: segments, their order, lengths and limits, and the detector joints on them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from panoptic_ros.errors import DataError, shown
from panoptic_ros.geometry.euler import ORDERS, euler_angles
from panoptic_ros.geometry.segment_chain import Chain

Array = np.ndarray
USUAL_ORDER = "yxz"  # flexion, abduction, rotation about an upright bone
SHORTEST, TALLEST = 0.4, 2.6  # m, limits of possible statures


@dataclass(frozen=True)
class JointOffset:
    """Offset from a joint of the segments to where a detector sees it (Malleson et al. 2020, 3.3.2).

    Args:
        frame: Name of the segment in whose frame the offset is.
        offset: m.
    """

    frame: str
    offset: tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class SegmentModel:
    """Segments of a generic person, lengths as shares of the stature.

    In the reference posture, a T facing +x, every segment's frame equals the world's: x forward, y left, z
    up. A segment's position is its proximal joint. There are 3 + 3 S degrees of freedom: the root's position,
    and for each segment the rotation vector of its frame in its parent's frame.

    Args:
        names: (S) parents before children, the root first.
        parents: (S,) indices, -1 = root.
        shares: (S, 3) joint in the parent's frame, as shares of the stature.
        lower, upper: (S, 3) limits of the rotation vectors, rad; the root's are not used.
        keypoints: Mapping {name of a detector's joint: (segment, (3,) share of the stature in its frame)}.
        ground: Segments that touch the floor when the body stands, e.g. feet and toes.
        joints: (S) names of the joints at which segments begin, see `joint_names`.
        orders: (S) order of each joint's three angles, e.g. "yxz": see `geometry.euler`.
        hinges: Mapping {segment: "x", "y" or "z"}, the axis of the parent about which the joint bends.
        offsets: Mapping {name of a detector's joint: its `JointOffset`}. It holds the joints measured for the
            detector in use.
    """

    names: tuple[str, ...]
    parents: Array
    shares: Array
    lower: Array
    upper: Array
    keypoints: Mapping[str, tuple[str, Array]]
    ground: tuple[str, ...] = ()
    joints: tuple[str, ...] = ()
    orders: tuple[str, ...] = ()
    hinges: Mapping[str, str] = field(default_factory=dict)
    offsets: Mapping[str, JointOffset] = field(default_factory=dict)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Return the names (3 S - 3) of the angles of all joints except the root's, in their orders.

        An angle is roll about x, pitch about y or yaw about z, of a left, right or middle joint. Names follow
        REP 155: "l_y_shoulder", "r_head".
        """
        found = []
        for joint, order in zip(self.joints[1:], self.orders[1:]):
            side, rest = (joint[:2], joint[2:]) if joint[:2] in ("l_", "r_") else ("", joint)
            found += [f"{side}{'rpy'['xyz'.index(axis)]}_{rest}" for axis in order]
        return tuple(found)

    def joint_angles(self, frames: Array) -> Array:
        """Return the joint angles (..., 3 S - 3) rad, as in `joint_names`, of frames (..., S, 3, 3)."""
        found = np.empty((*frames.shape[:-3], len(self.names) - 1, 3))
        for s in range(1, len(self.names)):
            local = frames[..., self.parents[s], :, :].swapaxes(-1, -2) @ frames[..., s, :, :]
            found[..., s - 1, :] = euler_angles(local, self.orders[s])
        return found.reshape(*frames.shape[:-3], -1)

    def index(self, name: str) -> int:
        """Return the index of a segment.

        Raises:
            DataError: if there is no segment of this name.
        """
        if name not in self.names:
            raise DataError(f"there is no segment {shown(name)}; the skeleton has {', '.join(self.names)}")
        return self.names.index(name)

    @property
    def freedoms(self) -> int:
        """Return the number of degrees of freedom."""
        return 3 + 3 * len(self.names)

    def body(self, stature: float) -> SegmentedBody:
        """Return the body of a person of this stature, m.

        Raises:
            DataError: if the stature is not between `SHORTEST` and `TALLEST`.
        """
        if not SHORTEST <= stature <= TALLEST:
            raise DataError(f"height_m = {stature} is not a stature; expected {SHORTEST} to {TALLEST} m")
        points = {name: (self.index(s), stature * share) for name, (s, share) in self.keypoints.items()}
        return SegmentedBody(self, stature * self.shares, points)

    def with_joint_offsets(self, offsets: Mapping[str, JointOffset]) -> SegmentModel:
        """Return the model with the measured offsets of a detector's joints.

        Raises:
            DataError: if there is no such joint, or an offset is in the frame of another segment than
                `frames_of` lists.
        """
        for name, found in offsets.items():
            if name not in self.keypoints:
                raise DataError(f"offset of {name}: the skeleton of segments has no such joint of a detector")
            frames = [self.names[k] for k in self.frames_of(name)]
            if found.frame not in frames:
                known = ", ".join(frames)
                raise DataError(f"offset of {name}: frame {shown(found.frame)} is none of {known}")
        return replace(self, offsets=dict(offsets))

    def frames_of(self, joint: str) -> tuple[int, ...]:
        """Return the segments in whose frames an offset of a detector's joint can be.

        These are its own segment, and for a joint at that segment's origin also the parent.
        """
        segment, share = self.keypoints[joint]
        own = self.index(segment)
        parent = int(self.parents[own])
        return (own,) if np.any(share) or parent < 0 else (own, parent)


@dataclass(frozen=True, eq=False)
class SegmentedBody:
    """Segments of one person.

    Args:
        model: Model of the segments.
        offsets: (S, 3) m, joints in the frames of their parents.
        keypoints: Mapping {joint of the detector: (segment, offset (3,) m)}.
        own: Joints whose keypoints were measured on this person.
    """

    model: SegmentModel
    offsets: Array
    keypoints: Mapping[str, tuple[int, Array]]
    own: frozenset[str] = frozenset()

    @property
    def chain(self) -> Chain:
        """Return the chain for compiled code."""
        return Chain(self.model.parents, np.ascontiguousarray(self.offsets, np.float64))

    @property
    def seen(self) -> Mapping[str, tuple[int, Array]]:
        """Return the keypoints at the positions where the detector sees them.

        A position measured on this person comes first; otherwise the model's measured offset is added.
        """
        found = dict(self.keypoints)
        for name, measured in self.model.offsets.items():
            if name in self.own:
                continue
            segment, place = self.keypoints[name]
            frame = self.model.index(measured.frame)
            begin = place if frame == segment else self.offsets[segment] + place
            found[name] = (frame, begin + np.array(measured.offset))
        return found

    def with_offsets(self, offsets: Mapping[str, Array]) -> SegmentedBody:
        """Return the body with these joints, in their parents' frames, instead of the scaled ones.

        Raises:
            DataError: on unknown segments.
        """
        own = self.offsets.copy()
        for name, offset in offsets.items():
            own[self.model.index(name)] = offset
        own[0] = 0.0
        return replace(self, offsets=own)

    def with_keypoints(self, keypoints: Mapping[str, tuple[str, Array]]) -> SegmentedBody:
        """Return the body with these detector joints instead of the nominal ones."""
        own = {name: (self.model.index(segment), offset) for name, (segment, offset) in keypoints.items()}
        return replace(self, keypoints={**self.keypoints, **own}, own=self.own | own.keys())


def read_model(document: Mapping[str, Any]) -> SegmentModel:
    """Return the segment skeleton of a YAML document, see `config/bodies/segments21.yaml`.

    Raises:
        DataError: naming the entry that is missing or wrong.
    """
    names: list[str] = []
    joints, orders, hinges = [], [], {}
    parents, shares, lower, upper = [], [], [], []
    for name, row in _mapping(document, "segments").items():
        parent = row.get("parent")
        if (parent is None and names) or (parent is not None and parent not in names):
            raise DataError(f"segment {name}: parent {shown(parent)} is not listed before it")
        names.append(str(name))
        parents.append(-1 if parent is None else names.index(parent))
        shares.append(_numbers(row.get("offset", (0, 0, 0)), 3, f"segment {name}: offset"))
        limits = row.get("limits_deg", [[-180, 180]] * 3)
        if len(limits) != 3:
            raise DataError(f"segment {name}: limits_deg has {len(limits)} pairs, expected 3")
        joints.append(str(row.get("joint", name)))
        orders.append(str(row.get("order", USUAL_ORDER)))
        if orders[-1] not in ORDERS:
            raise DataError(f"segment {name}: order {shown(orders[-1])} is none of {', '.join(ORDERS)}")
        if "hinge" in row:
            hinges[str(name)] = str(row["hinge"])
            if hinges[str(name)] not in ("x", "y", "z"):
                raise DataError(f"segment {name}: hinge {shown(row['hinge'])} is none of x, y, z")
        pairs = [_numbers(pair, 2, f"segment {name}: limits_deg") for pair in limits]
        lower.append(np.radians([pair[0] for pair in pairs]))
        upper.append(np.radians([pair[1] for pair in pairs]))
    points = {
        str(name): (str(row["segment"]), _numbers(row.get("offset", (0, 0, 0)), 3, f"keypoint {name}"))
        for name, row in _mapping(document, "keypoints").items()
    }
    model = SegmentModel(
        tuple(names),
        np.array(parents, np.int64),
        np.array(shares),
        np.array(lower),
        np.array(upper),
        points,
        tuple(document.get("ground", ())),
        tuple(joints),
        tuple(orders),
        hinges,
    )
    for segment in (*(s for s, _ in points.values()), *model.ground):
        model.index(segment)
    for segment in hinges:
        if model.index(segment) not in parents:
            raise DataError(f"segment {segment}: a hinge needs a segment after it, to which its bone leads")
    return model


def _mapping(document: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    found = document.get(key)
    rows: Mapping[str, Any] = found if isinstance(found, Mapping) else {}
    if not rows or not all(isinstance(row, Mapping) for row in rows.values()):
        raise DataError(f"a skeleton of segments needs {shown(key)}, a mapping of names to mappings")
    return rows


def _numbers(values: Any, count: int, where: str) -> Array:
    try:
        found = np.array(values, np.float64)
    except (TypeError, ValueError, OverflowError):
        found = np.zeros(0)
    if found.shape != (count,) or not np.isfinite(found).all():
        raise DataError(f"{where} = {shown(values)} is not {count} numbers")
    return found
