"""Skeleton sequences with identities over time, the input of an evaluation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from panoptic_ros.domain.checks import NOT_GIVEN, ShapeChecks, check_stamp
from panoptic_ros.errors import DataError

Array = np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class SkeletonFrame:
    """People of one instant.

    Args:
        stamp_ns: Timestamp.
        ids: Ids (P,) int64, unique within the frame.
        positions: Joints (P, J, 3) m, NaN where missing.
        covariances: Covariances (P, J, 3, 3) m^2, NaN where not reported. Default: NaN everywhere.
        ignored: Mask (P,) bool of truth people who may or may not be reported. Default: none.
        views: Number (P, J) of views that measured each joint, 0 = predicted or filled. Default: -1 = not
            reported.

    Raises:
        DataError: For inconsistent shapes or duplicate ids.
    """

    stamp_ns: int
    ids: Array
    positions: Array
    covariances: Array = NOT_GIVEN
    ignored: Array = NOT_GIVEN
    views: Array = NOT_GIVEN

    def __post_init__(self) -> None:
        object.__setattr__(self, "stamp_ns", check_stamp(self, self.stamp_ns))
        shapes = ShapeChecks(self)
        ids = shapes.store("ids", np.int64, "P")
        if len(np.unique(ids)) != len(ids):
            raise DataError(f"an id appears twice in the frame at {self.stamp_ns} ns: {ids.tolist()}")
        positions = shapes.store("positions", np.float64, "P J 3")
        if np.isinf(positions).any():
            raise DataError(f"a joint of the frame at {self.stamp_ns} ns is infinitely far away")
        if self.covariances is None:
            object.__setattr__(self, "covariances", np.full((*positions.shape, 3), np.nan))
        shapes.store("covariances", np.float64, "P J 3 3")
        if self.ignored is None:
            object.__setattr__(self, "ignored", np.zeros(len(ids), bool))
        shapes.store("ignored", bool, "P")
        if self.views is None:
            object.__setattr__(self, "views", np.full(positions.shape[:2], -1))
        shapes.store("views", np.int64, "P J")


@dataclass(frozen=True, slots=True, eq=False)
class SkeletonSequence:
    """Frames of one capture, all with the same joints, in any order of time.

    Raises:
        DataError: If a frame has another number of joints, or a joint name occurs twice.
    """

    joint_names: tuple[str, ...]
    frames: tuple[SkeletonFrame, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "joint_names", tuple(self.joint_names))
        object.__setattr__(self, "frames", tuple(self.frames))
        if len(set(self.joint_names)) != len(self.joint_names):
            raise DataError("a joint name appears twice")
        for frame in self.frames:
            if frame.positions.shape[1] != len(self.joint_names):
                raise DataError(
                    f"the frame at {frame.stamp_ns} ns has {frame.positions.shape[1]} joints, "
                    f"expected {len(self.joint_names)}"
                )

    def with_joints(self, joint_names: Sequence[str]) -> SkeletonSequence:
        """Return the same people with the joints of these names, in this order; absent joints are missing.

        Raises:
            DataError: If no joint of that name exists.
        """
        if tuple(joint_names) == self.joint_names:
            return self
        column = {name: i for i, name in enumerate(self.joint_names)}
        if not column.keys() & set(joint_names):
            raise DataError(
                f"the result has none of the truth's joints: {', '.join(self.joint_names[:4])}, ... "
                f"instead of {', '.join(list(joint_names)[:4])}, ..."
            )
        order = [column.get(name, len(column)) for name in joint_names]  # the last column is NaN
        return SkeletonSequence(tuple(joint_names), tuple(_reorder(f, order) for f in self.frames))


def _reorder(frame: SkeletonFrame, order: list[int]) -> SkeletonFrame:
    people = len(frame.ids)
    nowhere = np.full((people, 1, 3), np.nan)
    unknown = np.full((people, 1, 3, 3), np.nan)
    untold = np.full((people, 1), -1)
    return SkeletonFrame(
        frame.stamp_ns,
        frame.ids,
        np.concatenate([frame.positions, nowhere], axis=1)[:, order],
        np.concatenate([frame.covariances, unknown], axis=1)[:, order],
        frame.ignored,
        np.concatenate([frame.views, untold], axis=1)[:, order],
    )
