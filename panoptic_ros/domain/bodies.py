"""IMU samples, and solved bodies as they travel between stages."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from panoptic_ros.domain.checks import ShapeChecks, check_magnitude, check_not_infinite, check_stamp
from panoptic_ros.errors import DataError

Array = np.ndarray
FASTEST, HARDEST = 1e3, 1e5  # rad/s and m/s^2, limits that no IMU exceeds
UNIT = 0.05  # largest deviation of a quaternion's length from 1
_MEASURED = (  # fields of a sample: name, number of values, greatest absolute value, unit
    ("orientation", "4", 1.0 + UNIT, ""),
    ("rate", "3", FASTEST, "rad/s"),
    ("force", "3", HARDEST, "m/s^2"),
)


@dataclass(frozen=True, slots=True, eq=False)
class ImuSample:
    """Measurement of an IMU at an instant. A vector that was not measured is NaN in all its numbers.

    Args:
        device: Name of the device.
        stamp_ns: Timestamp on the device's clock.
        orientation: (4,) w x y z, the device's inertial frame (z up, arbitrary heading) from the device.
        rate: (3,) rad/s, angular velocity in the device's frame.
        force: (3,) m/s^2, specific force in the device's frame: 9.81 upwards at rest.

    Raises:
        DataError: if the orientation is not a unit quaternion, or a number exceeds what IMUs measure.
    """

    device: str
    stamp_ns: int
    orientation: Array
    rate: Array
    force: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "stamp_ns", check_stamp(self, self.stamp_ns))
        shapes = ShapeChecks(self)
        for name, size, limit, unit in _MEASURED:
            values = shapes.store(name, np.float64, size)
            numbers = values.tolist()  # lists are faster to check, at thousands of samples a second
            if not all(map(math.isfinite, numbers)) or max(map(abs, numbers)) > limit:
                what = f"ImuSample.{name} of {self.device}"
                check_magnitude(what, values, limit, unit)
                _check_whole(what, values)
                check_not_infinite(self, name)
        length = math.hypot(*self.orientation.tolist())
        if abs(length - 1.0) > UNIT:  # False for NaN
            raise DataError(f"ImuSample.orientation of {self.device} has the length {length:.3g}, expected 1")


def is_sound(values: Sequence[float]) -> bool:
    """Return whether the orientation, rate and force (10,) of a sample surely pass its checks.

    Close to the limits it may return False for values that pass.
    """
    w, x, y, z, p, q, r, a, b, c = values
    return (  # False for NaN
        abs(math.hypot(w, x, y, z) - 1.0) <= UNIT
        and math.hypot(p, q, r) <= FASTEST
        and math.hypot(a, b, c) <= HARDEST
    )


def _check_whole(what: str, values: Array) -> None:
    missing = np.isnan(values)
    if missing.any() and not missing.all():
        raise DataError(f"{what} is NaN in part: {values.tolist()}; all of it, or none")


class BodySource(IntEnum):
    """Data that a body was solved from at its instant, in addition to its IMUs."""

    PREDICTED = 0  # its earlier motion
    IMUS = 1  # no camera: its position is unknown and drifts; positions relative to the root are valid
    TRACK = 2  # 2D poses of the views that belong to its track
    VIEWS = 3  # without a track: the 2D poses nearest to the predicted body
    JOINTS = 4  # 3D joints


@dataclass(frozen=True, slots=True, eq=False)
class BodyStateSet:
    """Bodies of B people at one instant, with S segments; see `domain.segments.SegmentModel`.

    Args:
        index: Counts the instants from 0.
        newest_ns: Timestamp of the newest sample received before this set.
        skeleton_hash: Hash of the skeleton whose J joints `keypoints` are.
        segment_names: (S,), parents before children.
        parents: (S,) indices, -1 = the root.
        ids: (B,) ids of the subjects, equal to those of their skeletons.
        sources: (B,) `BodySource`.
        views, devices: (B,) number of cameras and IMUs used at this instant.
        offsets: (B, S, 3) m, joints in the frames of their parents: lengths of the body.
        freedoms: (B, 3 + 3 S) degrees of freedom: position of the root, m, and rotation vectors, rad, of
            every segment in its parent's frame (of the root: in the world).
        positions: (B, S, 3) m of the proximal joints.
        orientations: (B, S, 4) w x y z, world from segment.
        velocities: (B, S, 6) m/s and rad/s in the world.
        covariances: (B, S, 6, 6) of position, m, and rotation, rad, both in the world; NaN = unknown.
        keypoints: (B, J, 3) m, NaN where the body has no such joint.
        keypoint_covariances: (B, J, 3, 3) m^2. Position covariances, also those of segments, include the
            detector's constant biases (`SkeletonModel.bias_floors`), and errors of the calibration as if
            all cameras that see a point had placed it.
    """

    index: int
    stamp_ns: int
    newest_ns: int
    skeleton_hash: str
    segment_names: tuple[str, ...]
    parents: Array
    ids: Array
    sources: Array
    views: Array
    devices: Array
    offsets: Array
    freedoms: Array
    positions: Array
    orientations: Array
    velocities: Array
    covariances: Array
    keypoints: Array
    keypoint_covariances: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "stamp_ns", check_stamp(self, self.stamp_ns))
        object.__setattr__(self, "newest_ns", check_stamp(self, self.newest_ns, "newest_ns"))
        object.__setattr__(self, "segment_names", tuple(str(name) for name in self.segment_names))
        shapes = ShapeChecks(self)
        shapes.sizes["S"] = len(self.segment_names)
        shapes.sizes["D"] = 3 + 3 * len(self.segment_names)
        parents = shapes.store("parents", np.int32, "S")
        ids = shapes.store("ids", np.int64, "B")
        sources = shapes.store("sources", np.uint8, "B")
        for name in ("views", "devices"):
            shapes.store(name, np.int32, "B")
        for name, letters in _SHAPES.items():
            shapes.store(name, np.float64, letters)
        if (parents >= np.arange(len(parents))).any() or (parents[1:] < 0).any():
            raise DataError(f"BodyStateSet.parents = {parents.tolist()}: parents stand before their children")
        if len(set(ids.tolist())) != len(ids):
            raise DataError(f"an id appears twice among the bodies {ids.tolist()}")
        if sources.size and sources.max() > max(BodySource):
            raise DataError(f"BodyStateSet.sources has the unknown source {sources.max()}")
        for name in ("offsets", "freedoms", "positions", "orientations", "velocities"):
            if not np.isfinite(getattr(self, name)).all():
                raise DataError(f"BodyStateSet.{name} is not finite")
        check_not_infinite(self, "covariances keypoints keypoint_covariances")


_SHAPES = {
    "offsets": "B S 3",
    "freedoms": "B D",
    "positions": "B S 3",
    "orientations": "B S 4",
    "velocities": "B S 6",
    "covariances": "B S 6 6",
    "keypoints": "B J 3",
    "keypoint_covariances": "B J 3 3",
}
