"""Ground truth skeletons as messages for a page."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator

import numpy as np

from panoptic_ros.domain import JointState, RefinedPoseSet, SkeletonModel
from panoptic_ros.io.messages import bag_messages, to_message
from panoptic_ros.io.messages.family import bag_typestore
from panoptic_ros.io.plain_formats import PlainSkeletonFrame, PlainSkeletons

KEY = "truth"  # key of the page's topic for ground truth
MESSAGE = "panoptic_msgs/msg/Skeletons"
SPREAD_M = 1e-4  # m; nominal standard deviation, because messages require covariances


class TruthSkeletons:
    """Ground truth skeletons of a file, mapped to the joints of a scene.

    Joints absent from the file are marked missing.
    """

    def __init__(self, plain: PlainSkeletons, skeleton: SkeletonModel):
        self._frames = sorted(plain.frames, key=lambda frame: frame.stamp_ns)
        self._stamps = [frame.stamp_ns for frame in self._frames]
        self._skeleton = skeleton
        known = {name: place for place, name in enumerate(plain.joint_names)}
        self._places = [known.get(name, -1) for name in skeleton.joint_names]

    def between(self, begin_ns: int, end_ns: int) -> Iterator[bytes]:
        """Yield the CDR bytes of the frames with timestamps in [begin_ns, end_ns)."""
        first, last = (bisect_left(self._stamps, stamp) for stamp in (begin_ns, end_ns))
        for frame in self._frames[first:last]:
            message = to_message(self._record(frame), bag_messages())
            yield bytes(bag_typestore().serialize_cdr(message, MESSAGE))

    def people(self) -> Iterator[tuple[int, list[int]]]:
        """Yield the timestamp and the ids of every frame, in order."""
        for frame in self._frames:
            yield frame.stamp_ns, frame.ids.tolist()

    def _record(self, frame: PlainSkeletonFrame) -> RefinedPoseSet:
        shape = len(frame.ids), len(self._places)
        known = np.array([place >= 0 for place in self._places])
        positions = np.where(known[:, None], frame.positions[:, self._places], np.nan)
        there = np.asarray(np.isfinite(positions).all(-1))
        return RefinedPoseSet(
            frame.index,
            frame.stamp_ns,
            self._skeleton.hash,
            positions,
            np.where(there[..., None, None], SPREAD_M**2 * np.eye(3), np.nan),
            there.astype(float),
            np.zeros(shape, int),
            np.where(there, JointState.MEASURED, JointState.MISSING),
            np.ones(len(frame.ids)),
            ids=frame.ids,
        )
